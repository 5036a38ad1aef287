#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
#
# Builds the example package outside of the workspace, as somebody else's package finds the libraries, and runs it.
import os
import pathlib
import subprocess
import tempfile
import unittest

import rosunit

EXAMPLE = pathlib.Path(__file__).resolve().parents[2] / 'docs' / 'examples' / 'two_maps'
ROS_LIBRARIES = ('roscpp', 'rosconsole', 'nodelet', 'tf2', 'rosbag', 'xmlrpcpp', 'diagnostic', 'class_loader')


class ExampleTest(unittest.TestCase):

    def run_in(self, folder, *command):
        done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.assertEqual(0, done.returncode, done.stdout)
        return done.stdout

    def test_is_built_against_the_libraries_without_ros(self):
        if not EXAMPLE.is_dir():
            self.skipTest('the packages were added to the workspace without ' + str(EXAMPLE))
        with tempfile.TemporaryDirectory() as folder:
            self.run_in(folder, 'cmake', str(EXAMPLE), '-DCMAKE_PREFIX_PATH=' + os.environ['CMAKE_PREFIX_PATH'],
                        '-DPYTHON_EXECUTABLE=/usr/bin/python3')
            self.run_in(folder, 'make')
            program = str(pathlib.Path(folder) / 'devel' / 'lib' / 'two_maps' / 'two_maps')
            self.assertIn('the wall ahead is at x = 4.0', self.run_in(folder, program))
            libraries = self.run_in(folder, 'ldd', program)
            self.assertIn('librtree_occupancy_map_core.so', libraries)
            for name in ROS_LIBRARIES:
                self.assertNotIn('lib' + name, libraries)


if __name__ == '__main__':
    rosunit.unitrun('mapping_bringup', 'example', ExampleTest)
