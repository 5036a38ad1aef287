#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
#
# Loads every launch file that the packages ship, with the YAML files that it names, as roslaunch does.
import os
import pathlib
import re
import runpy
import tempfile
import unittest

import roslaunch.arg_dump
import roslaunch.config
import roslib.packages
import rosbag
import rospkg
import rospy
import rosunit
import std_msgs.msg

PACKAGES = ['hokuyo_sick_drivers', 'ibuild_loop_closure', 'intensity_hector_slam', 'intensity_place_recognition',
            'laser_intensity_calib', 'mapping_bringup', 'pose_graph', 'rtree_occupancy_map']
LAUNCH_FILES = [f for package in PACKAGES
                for f in sorted((pathlib.Path(rospkg.RosPack().get_path(package)) / 'launch').glob('*.launch'))]


def load(launch_file, *args):
    """The launch file's configuration; arguments without a default get some value."""
    required = [name + (':=localhost' if name.endswith('address') else ':=/nowhere')
                for name, (_, default) in arguments(launch_file).items() if default is None]
    return roslaunch.config.load_config_default([(str(launch_file), required + list(args))], None)


def arguments(launch_file):
    """Name -> (doc, default)."""
    return roslaunch.arg_dump.get_args([str(launch_file)])


def find(name):
    return next(f for f in LAUNCH_FILES if f.name == name)


def topics_of(rviz_file):
    """All that an RViz file subscribes to or publishes on."""
    return re.findall(r'Topic: (\S+)', pathlib.Path(rviz_file).read_text())


def replay():
    """What is in mapping_common's script."""
    source = os.path.join(rospkg.RosPack().get_path('mapping_common'), 'scripts', 'replay')
    return runpy.run_path(source if os.path.exists(source) else roslib.packages.find_node('mapping_common', 'replay')[0])


def node_of_type(config, node_type):
    return next((node for node in config.nodes if node.type == node_type), None)


class LaunchFilesTest(unittest.TestCase):

    def test_all_are_among_them(self):
        names = [f.name for f in LAUNCH_FILES]
        for name in ('hokuyo.launch', 'loop_closure.launch', 'mapping_bag.launch', 'pose_graph.launch', 'reflectivity.launch', 'robot.launch',
                     'slam.launch', 'stop_scan_go.launch', 'two_machines.launch'):
            self.assertIn(name, names)

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

    def test_rviz_shows_the_topics_that_are_given(self):
        shown = 0
        for launch_file in LAUNCH_FILES:
            if 'rviz' not in arguments(launch_file):
                continue
            rviz = node_of_type(load(launch_file, 'rviz:=true'), 'rviz')
            topics = topics_of(rviz.args.split()[1])
            for topic in topics:
                self.assertFalse(topic.startswith('/'), topic + ' would be the same in every namespace')
            for name, (doc, default) in arguments(launch_file).items():
                if doc.startswith('Topic') and default in topics:
                    shown += 1
                    changed = node_of_type(load(launch_file, 'rviz:=true', name + ':=other/one'), 'rviz')
                    self.assertIn([default, 'other/one'], changed.remap_args, launch_file.name)
        self.assertGreater(shown, 10)

    def test_rviz_follows_the_name_of_the_nodelet(self):
        rviz = node_of_type(load(find('loop_closure.launch'), 'rviz:=true', 'name:=other'), 'rviz')
        self.assertIn(['loop_closure/debug_image', 'other/debug_image'], rviz.remap_args)

    def test_rviz_is_given_the_fixed_frame(self):
        for name, argument in (('hokuyo.launch', 'frame_id'), ('sick.launch', 'frame_id'), ('zf_reader.launch', 'parent_frame'),
                               ('reflectivity.launch', 'rviz_frame'), ('slam.launch', 'map_frame'),
                               ('mapping.launch', 'frame_id'), ('loop_closure.launch', 'fixed_frame'),
                               ('pose_graph.launch', 'map_frame')):
            rviz = node_of_type(load(find(name), 'rviz:=true', argument + ':=other'), 'rviz')
            self.assertEqual(['-f', 'other'], rviz.args.split()[-2:], name)

    def test_nodelets_start_without_parameters_of_earlier_runs(self):
        for launch_file in LAUNCH_FILES:
            for node in load(launch_file).nodes:
                if node.type == 'nodelet' and node.args != 'manager':
                    self.assertIn(node.namespace + node.name + '/', load(launch_file).clear_params, launch_file.name)

    def test_relative_paths_are_those_of_the_shell(self):
        here = os.environ['PWD'] = os.getcwd()
        for name, argument, expected in (('mapping.launch', 'map_file:=a.map', '/mapping/map_file'),
                                         ('slam.launch', 'save_on_shutdown:=a.map', '/slam/save_on_shutdown'),
                                         ('zf_reader.launch', 'file:=a.map', '/zf_reader/file')):
            self.assertEqual(here + '/a.map', load(find(name), argument).params[expected].value)
        for name in ('slam_bag.launch', 'mapping_bag.launch', 'loop_closure_bag.launch'):
            replay = node_of_type(load(find(name), 'bag:=a.bag'), 'replay')
            self.assertEqual(here + '/a.bag', replay.args.split()[0])
            self.assertEqual('/absolute/a.bag', node_of_type(load(find(name), 'bag:=/absolute/a.bag'), 'replay').args.split()[0])

    def test_replays_are_given_what_they_understand(self):
        parse = replay()['parse']
        for name, argument in (('slam_bag.launch', 'scan:=one'), ('mapping_bag.launch', 'cloud:=one'),
                               ('loop_closure_bag.launch', 'image:=one')):
            node = node_of_type(load(find(name), 'bag:=/a.bag', argument, 'play_args:=--start 10'), 'replay')
            arguments = parse(node.args.split())
            self.assertEqual('/a.bag', arguments.bag)
            self.assertIn('one', arguments.topics)
            self.assertEqual(['--clock', '--delay', '2', '--rate', '1.0', '--start', '10'], arguments.play)

    def test_replays_say_what_a_recording_lacks(self):
        check = replay()['check']
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, 'a.bag')
            with rosbag.Bag(path, 'w') as bag:
                bag.write('scan', std_msgs.msg.Empty(), rospy.Time(1))  # without a slash, as some recorders do
            self.assertEqual('', check(path, ['cloud', 'scan']))
            self.assertEqual('', check(path, ['/scan']))
            self.assertIn('has no topic /cloud, so nothing may happen. It has /scan (std_msgs/Empty)', check(path, ['cloud']))
            with self.assertRaisesRegex(ValueError, 'there is no file .*b.bag'):
                check(os.path.join(folder, 'b.bag'), [])

    def test_live_devices_run_on_the_wall_clock(self):
        for name in ('hokuyo.launch', 'sick.launch', 'robot.launch'):
            self.assertEqual(False, load(find(name)).params['/use_sim_time'].value)

    def test_robot_in_a_namespace(self):
        config = load(find('robot.launch'), 'robot:=alice', 'laser_pose:=0.2 0 0.3 0 0 0', 'mapping:=true', 'rviz:=true',
                      'loop_closure:=true', 'calibration:=/nowhere.yaml')
        for node in config.nodes:
            self.assertEqual('/alice/', node.namespace, node.name)
        frames = {name: config.params['/alice/' + name].value for name in (
            'hokuyo/frame_id', 'slam/base_frame', 'slam/odom_frame', 'slam/map_frame', 'mapping/frame_id',
            'slam/tf_map_scanmatch_transform_frame_name', 'loop_closure/fixed_frame')}
        for name, frame in frames.items():
            self.assertTrue(frame.startswith('alice/'), name + ' is ' + frame)
        self.assertEqual('0.2 0 0.3 0 0 0 alice/base_link alice/laser',
                         node_of_type(config, 'static_transform_publisher').args)
        self.assertIn(['scan', 'scan_reflectivity'], next(n for n in config.nodes if n.name == 'slam').remap_args)

    def test_robot_with_and_without_odometry(self):
        for arguments_, slam, loops in (([], 'base_link', 'map'), (['odom_frame:=odom'], 'odom', 'odom'),
                                        (['odom_frame:=odom', 'robot:=bob'], 'bob/odom', 'bob/odom')):
            params = load(find('robot.launch'), 'loop_closure:=true', *arguments_).params
            at = '/bob/' if 'robot:=bob' in arguments_ else '/'
            self.assertEqual(slam, params[at + 'slam/odom_frame'].value)
            self.assertEqual(loops, params[at + 'loop_closure/fixed_frame'].value)

    def test_no_nodelet_waits_for_another(self):
        for config in (load(find('stop_scan_go.launch')),
                       load(find('robot.launch'), 'calibration:=/nowhere.yaml', 'mapping:=true', 'loop_closure:=true',
                            'place_recognition:=true', 'pose_graph:=true')):
            nodelets = [node for node in config.nodes if node.args.startswith('load ')]
            self.assertGreaterEqual(len(nodelets), 4)
            self.assertGreaterEqual(config.params['/manager/num_worker_threads'].value, len(nodelets))

    def test_two_machines_share_the_work(self):
        config = load(find('two_machines.launch'), 'base_address:=192.168.0.2', 'robot:=alice', 'calibration:=/nowhere.yaml',
                      'place_recognition:=true')
        machines = {node.name: node.machine_name for node in config.nodes}
        self.assertEqual({'manager': None, 'hokuyo': None, 'reflectivity': None, 'slam': None, 'base_manager': 'base',
                          'mapping': 'base', 'loop_closure': 'base', 'place_recognition': 'base', 'pose_graph': 'base'}, machines)
        self.assertEqual('192.168.0.2', config.machines['base'].address)
        nodes = {node.name: node for node in config.nodes}
        for name, machine in machines.items():
            self.assertEqual('/alice/', nodes[name].namespace)
            manager = 'base_manager' if machine else 'manager'
            if not name.endswith('manager'):
                self.assertTrue(nodes[name].args.endswith(' ' + manager), name)
        self.assertIn(['scan', 'scan_reflectivity'], nodes['slam'].remap_args)
        self.assertIn(['scan', 'key_scans'], nodes['pose_graph'].remap_args)

    def test_the_robot_without_a_manager(self):
        config = load(find('robot.launch'), 'manager:=none', 'pose_graph:=true')
        self.assertEqual({'standalone'}, {node.args.split()[0] for node in config.nodes if node.type == 'nodelet'})
        self.assertIn(['scan', 'scan'], next(n for n in config.nodes if n.name == 'pose_graph').remap_args)

    def test_scans_of_unknown_poses(self):
        params = load(find('stop_scan_go.launch'), 'file:=/a.e57', 'scanner_frame:=zf').params
        self.assertEqual([False, 'zf', 'zf', 'clouds', False],
                         [params[name].value for name in ('/zf_reader/publish_tf', '/zf_reader/frame_id', '/pose_graph/base_frame',
                                                          '/pose_graph/key_poses', '/pose_graph/graph/planar')])

    def test_a_calibrated_sick_sends_intensities(self):
        self.assertEqual('none', load(find('robot.launch'), 'laser:=sick').params['/sick/intensity'].value)
        calibrated = load(find('robot.launch'), 'laser:=sick', 'calibration:=/nowhere.yaml')
        self.assertEqual('normalised', calibrated.params['/sick/intensity'].value)

    def test_mapping_arguments(self):
        mapping = find('mapping.launch')
        default = load(mapping)
        self.assertEqual('standalone rtree_occupancy_map/MappingNodelet', node_of_type(default, 'nodelet').args)
        self.assertEqual(0.2, default.params['/mapping/resolution'].value)
        changed = load(mapping, 'manager:=lidar/manager', 'resolution:=1', 'name:=other', 'frame_id:=odom')
        self.assertEqual('load rtree_occupancy_map/MappingNodelet lidar/manager',
                         node_of_type(changed, 'nodelet').args)
        self.assertEqual(1.0, changed.params['/other/resolution'].value)
        self.assertEqual('odom', changed.params['/other/frame_id'].value)


if __name__ == '__main__':
    rosunit.unitrun('mapping_bringup', 'launch_files', LaunchFilesTest)
