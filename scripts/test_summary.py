#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Sums up JUnit results: prints each failed and skipped test, then "N passed, N failed, N skipped"."""
import argparse
import pathlib
import sys
import xml.etree.ElementTree as ElementTree


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('results', type=pathlib.Path, help='folder of JUnit files')
    parser.add_argument('log', help='where the output of the tests is')
    arguments = parser.parse_args()
    results, log = arguments.results, arguments.log
    passed = failed = skipped = 0
    for file in sorted(results.rglob('*.xml')):
        try:
            cases = list(ElementTree.parse(file).iter('testcase'))
        except ElementTree.ParseError:
            print('FAILED  %s: not readable' % file)
            failed += 1
            continue
        for case in cases:
            name = '%s: %s.%s' % (file.relative_to(results), case.get('classname'), case.get('name'))
            faults = case.findall('failure') + case.findall('error')
            skips = case.findall('skipped')
            if faults:
                failed += 1
                text = (faults[0].get('message') or '') + '\n' + (faults[0].text or '')
                print('FAILED  %s\n        %s' % (name, text.strip().replace('\n', '\n        ')))
            elif skips or case.get('result') == 'skipped' or case.get('status') == 'notrun':
                skipped += 1
                reason = (skips[0].get('message') or '').strip().split('\n')[-1] if skips else ''
                print('skipped %s %s' % (name, reason))
            else:
                passed += 1
    if passed == 0:
        print('FAILED  no test has run: see %s' % log)
        failed += 1
    if failed:
        print('The tests\' output is in %s' % log)
    print('%d passed, %d failed, %d skipped' % (passed, failed, skipped))
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
