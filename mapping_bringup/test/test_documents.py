#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
#
# Looks up what the pages of this project name: files that they link to, launch files with their arguments, and programs.
import pathlib
import re
import shlex
import unittest

import roslaunch.arg_dump
import roslib.packages
import rospkg
import rosunit

ROOT = pathlib.Path(__file__).resolve().parents[2]
# What the pages name and Debian doesn't have.
ELSEWHERE = {'amcl', 'map_server', 'rqt_reconfigure', 'urdf_tutorial'}


def pages():
    """All that git would show of the project: not what was built."""
    return [page for page in sorted(ROOT.rglob('*.md'))
            if not {'build', 'devel', 'install', 'logs', 'out', 'src'} & set(page.relative_to(ROOT).parts[:-1])]


def without_code(text):
    return re.sub(r'`[^`\n]*`', '', re.sub(r'(?ms)^```.*?^```', '', text))


def links(text):
    """Targets of links and pictures."""
    return re.findall(r'\]\(([^)\s]+)\)', without_code(text)) + re.findall(r'src="([^"]+)"', without_code(text))


def anchors(text):
    """What GitHub calls the headings."""
    return {re.sub(r'[^\w\- ]', '', heading.strip().lower()).replace(' ', '-')
            for heading in re.findall(r'(?m)^#+ (.*)$', without_code(text))}


def commands(text):
    """Words of each roslaunch and rosrun, in blocks and in lines."""
    blocks = re.findall(r'(?ms)^```(\w*)\n(.*?)^```', text)
    code = [block for language, block in blocks if language in ('', 'sh', 'xml')]
    code += re.findall(r'`((?:roslaunch|rosrun) [^`]*)`', text)
    for block in code:
        for line in block.replace('\\\n', ' ').splitlines():
            for command in re.findall(r'\b(?:roslaunch|rosrun) .*', line):
                words = shlex.split(command, comments=True)
                if len(words) > 2 and not words[1].startswith('-') and '...' not in words[2]:
                    yield words


class DocumentsTest(unittest.TestCase):

    def setUp(self):
        if not (ROOT / 'README.md').is_file():
            self.skipTest('the packages were taken without their pages')
        self.maxDiff = None

    def report(self, faults):
        self.assertEqual('', '\n'.join(faults))

    def test_links_lead_somewhere(self):
        self.assertIn(ROOT / 'README.md', pages())
        faults = []
        for page in pages():
            for link in links(page.read_text()):
                path, _, anchor = link.partition('#')
                target = page.parent / path if path else page
                if re.match(r'[a-z]+:', link):
                    continue
                if not target.exists():
                    faults.append('{}: {}'.format(page.relative_to(ROOT), link))
                elif anchor and anchor not in anchors(target.read_text()):
                    faults.append('{}: {} has no such heading'.format(page.relative_to(ROOT), link))
        self.report(faults)

    def test_commands_exist(self):
        packages = rospkg.RosPack()
        faults = []
        found = 0
        for page in pages():
            for tool, package, name, *arguments in commands(page.read_text()):
                where = '{}: {} {} {}'.format(page.relative_to(ROOT), tool, package, name)
                if package not in packages.list():
                    if package not in ELSEWHERE:
                        faults.append(where + ': no such package')
                elif tool == 'rosrun':
                    if not roslib.packages.find_node(package, name):
                        faults.append(where + ': no such program')
                else:
                    files = roslib.packages.find_resource(package, name)
                    known = roslaunch.arg_dump.get_args(files[:1]) if files else None
                    if known is None:
                        faults.append(where + ': no such file')
                        continue
                    faults += ['{}: no argument {}'.format(where, a) for a in arguments
                               if ':=' in a and a.split(':=')[0] not in known]
                found += 1
        self.report(faults)
        self.assertGreater(found, 20)

    def test_paths_in_commands_exist(self):
        faults = []
        for page in pages():
            for path in re.findall(r'(?<![\w/])((?:config|launch|scripts)/[\w./-]*\w)', page.read_text()):
                placeholder = re.search('[A-Z]{4}', path)
                if not placeholder and not any((folder / path).exists()
                                               for folder in (ROOT, page.parent, page.parent.parent)):
                    faults.append('{}: {}'.format(page.relative_to(ROOT), path))
        self.report(faults)

    def test_the_checks_see_faults(self):
        text = '# A b: c\n[x](nowhere.md) `[y](code.md)` <img src="p.png">\n```sh\nroslaunch a b.launch \\\n  c:=d  # e\n```\n'
        self.assertEqual(['nowhere.md', 'p.png'], links(text))
        self.assertEqual({'a-b-c'}, anchors(text))
        self.assertEqual([['roslaunch', 'a', 'b.launch', 'c:=d']], list(commands(text)))


if __name__ == '__main__':
    rosunit.unitrun('mapping_bringup', 'documents', DocumentsTest)
