#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
#
# Loads every launch file that the workspace ships, with the YAML files that it names, as roslaunch does.
import os
import pathlib
import unittest

import roslaunch.arg_dump
import roslaunch.config
import rosunit

LAUNCH_FILES = sorted((pathlib.Path(__file__).resolve().parents[2] / 'launch').glob('*.launch'))


def load(launch_file, *args):
    """The launch file's configuration; arguments without a default get some value."""
    required = [name + ':=/nowhere' for name, (_, default) in arguments(launch_file).items() if default is None]
    return roslaunch.config.load_config_default([(str(launch_file), required + list(args))], None)


def arguments(launch_file):
    """Name -> (doc, default)."""
    return roslaunch.arg_dump.get_args([str(launch_file)])


def node_of_type(config, node_type):
    return next((node for node in config.nodes if node.type == node_type), None)


class LaunchFilesTest(unittest.TestCase):

    def test_mapping_is_among_them(self):
        self.assertIn('mapping.launch', [f.name for f in LAUNCH_FILES])
        self.assertIn('mapping_bag.launch', [f.name for f in LAUNCH_FILES])

    def test_each_argument_has_a_doc(self):
        for launch_file in LAUNCH_FILES:
            for name, (doc, _) in arguments(launch_file).items():
                self.assertTrue(doc, 'argument {} of {}'.format(name, launch_file.name))

    def test_each_loads(self):
        for launch_file in LAUNCH_FILES:
            self.assertTrue(load(launch_file).nodes, launch_file.name)

    def test_rviz_is_given_a_file(self):
        for launch_file in LAUNCH_FILES:
            if 'rviz' not in arguments(launch_file):
                continue
            self.assertIsNone(node_of_type(load(launch_file, 'rviz:=false'), 'rviz'), launch_file.name)
            args = node_of_type(load(launch_file, 'rviz:=true'), 'rviz').args.split()
            self.assertTrue(os.path.getsize(args[args.index('-d') + 1]), launch_file.name)

    def test_mapping_arguments(self):
        mapping = next(f for f in LAUNCH_FILES if f.name == 'mapping.launch')
        default = load(mapping)
        self.assertEqual('standalone rtree_occupancy_map/MappingNodelet', node_of_type(default, 'nodelet').args)
        self.assertEqual(0.2, default.params['/mapping/resolution'].value)
        changed = load(mapping, 'manager:=lidar/manager', 'resolution:=1', 'name:=other', 'frame_id:=odom')
        self.assertEqual('load rtree_occupancy_map/MappingNodelet lidar/manager',
                         node_of_type(changed, 'nodelet').args)
        self.assertEqual(1.0, changed.params['/other/resolution'].value)
        self.assertEqual('odom', changed.params['/other/frame_id'].value)


if __name__ == '__main__':
    rosunit.unitrun('rtree_occupancy_map', 'launch_files', LaunchFilesTest)
