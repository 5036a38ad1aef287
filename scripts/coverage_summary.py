#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints the line coverage of the packages' cores, by what gcov says of the tests that have run."""
import argparse
import collections
import json
import os
import pathlib
import re
import subprocess

WORKSPACE = pathlib.Path(__file__).resolve().parents[1]
CORE = re.compile(r'(\w+)/(src|include/\1)/(?!ros/|nodelets/|testing/|.*/ros/)[\w/]+\.(cpp|h)')
BATCH = 50  # files that one process of gcov reads


def counts_of(build):
    """File of a core, relative to the workspace -> line -> how often it ran."""
    counts = collections.defaultdict(collections.Counter)
    notes = sorted(build.rglob('*.gcno'))  # of all that was compiled, whether it ran or not
    for i in range(0, len(notes), BATCH):
        command = ['gcov', '--json-format', '--stdout'] + [str(note) for note in notes[i:i + BATCH]]
        text = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=str(build), check=True).stdout
        for document in text.decode().splitlines():
            document = json.loads(document)
            for file in document['files']:
                path = os.path.realpath(os.path.join(document['current_working_directory'], file['file']))
                path = os.path.relpath(path, str(WORKSPACE))
                if CORE.fullmatch(path):
                    for line in file['lines']:
                        counts[path][line['line_number']] += line['count']
    return counts


def ranges(lines):
    """[1, 2, 3, 7] -> '1-3, 7'"""
    found = []
    for line in sorted(lines):
        if found and line == found[-1][1] + 1:
            found[-1][1] = line
        else:
            found.append([line, line])
    return ', '.join(str(a) if a == b else '%d-%d' % (a, b) for a, b in found)


def percent(counts):
    return 100.0 * sum(count > 0 for count in counts) / len(counts) if counts else 100.0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('build', type=pathlib.Path, help='folder with what gcc --coverage wrote')
    parser.add_argument('packages', nargs='*', help='those to print; default: all')
    parser.add_argument('--least', type=float, default=90.0, help='files under this percentage are named (default 90)')
    arguments = parser.parse_args()
    packages, under = collections.defaultdict(list), []
    for path, counts in sorted(counts_of(arguments.build).items()):
        package = path.split('/')[0]
        if not arguments.packages or package in arguments.packages:
            packages[package].append((path, counts))
    for package, files in packages.items():
        lines = [count for _, counts in files for count in counts.values()]
        print('%5.1f %%  %5d lines  %s' % (percent(lines), len(lines), package))
        for path, counts in files:
            covered = percent(counts.values())
            print('%5.1f %%  %5d lines    %s' % (covered, len(counts), path[len(package) + 1:]))
            if covered < arguments.least:
                under.append('%5.1f %%  %s: %s' % (covered, path, ranges(l for l, count in counts.items() if count == 0)))
    print('%d files under %g %%%s' % (len(under), arguments.least, ', with the lines that nothing ran:' if under else ''))
    print('\n'.join(under))


if __name__ == '__main__':
    main()
