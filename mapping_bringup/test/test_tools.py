#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
#
# Every program of the packages, as rosrun finds it, and every script of the workspace: says how it is used, exits with 0
# where that was asked for and with 2 where the usage was wrong, and doesn't end by a signal or in a traceback.
import os
import pathlib
import re
import subprocess
import unittest

import catkin.find_in_workspaces
import rosunit

PACKAGES = ['hokuyo_sick_drivers', 'ibuild_loop_closure', 'intensity_hector_slam', 'intensity_place_recognition',
            'laser_intensity_calib', 'mapping_common', 'mapping_simulation', 'pose_graph', 'rosbag_tests',
            'rtree_occupancy_map']
# Without matplotlib, figures can't be drawn, but help can be had: an empty module stands in its place.
SCRIPTS = pathlib.Path(__file__).resolve().parents[2] / 'scripts'
WITHOUT_MATPLOTLIB = str(pathlib.Path(__file__).resolve().parent / 'without_matplotlib')


def programs():
    for package in PACKAGES:
        for folder in catkin.find_in_workspaces.find_in_workspaces(['libexec'], package):
            for file in sorted(pathlib.Path(folder).iterdir()):
                if os.access(str(file), os.X_OK) and file.is_file() and '_test_' not in file.name:
                    yield package, str(file)
    for file in sorted(SCRIPTS.iterdir()):
        if os.access(str(file), os.X_OK) and file.is_file():
            yield 'scripts', str(file)


def run(*command, **environment):
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
                              timeout=60, stdin=subprocess.DEVNULL,
                              env=dict(os.environ, ROS_MASTER_URI='http://localhost:1', **environment))
        return done.returncode, done.stdout
    except subprocess.TimeoutExpired:
        return -1, 'it went on for more than 60 s'


class ToolsTest(unittest.TestCase):

    def test_there_are_some(self):
        self.assertGreater(len(list(programs())), 30)

    def check_each(self, arguments, exit_code, **environment):
        faults = []
        for package, program in programs():
            code, text = run(program, *arguments, **environment)
            says_how = re.search('usage|--help|scripts/' + pathlib.Path(program).name, text, re.IGNORECASE)
            if code != exit_code or 'Traceback' in text or not says_how:
                faults.append('%s %s: exit code %d, "%s"' % (package, program, code, text.strip()[-500:]))
        self.assertFalse(faults, '\n'.join(faults))

    def test_each_answers_help(self):
        self.check_each(['--help'], 0, PYTHONPATH=WITHOUT_MATPLOTLIB + ':' + os.environ['PYTHONPATH'])

    def test_each_rejects_an_option_that_there_is_not(self):
        self.check_each(['--no-such-option'], 2)


if __name__ == '__main__':
    rosunit.unitrun('mapping_bringup', 'tools', ToolsTest)
