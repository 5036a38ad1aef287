#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs robot.launch and base.launch in two network namespaces, drives, cuts the link between them, and compares the edges
that the robot has published with those of the base station's session.

Run by scripts/two_machines.
"""
import argparse
import collections
import contextlib
import glob
import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import time

import rosbag

ROBOT, BASE = '10.213.17.1', '10.213.17.2'
NAMES = {ROBOT: 'robot_%d' % os.getpid(), BASE: 'base_%d' % os.getpid()}
MASTER = 'http://%s:11311' % ROBOT
CUT_AT = 0.45  # share of the drive
TABLE_AT = 0.95  # the same, of the mean bandwidths since the begin
LAG = 2.0      # s, that the base station may be behind when it has caught up
LONGEST_GAP = 0.5  # s, between two poses of the robot


def fail(text):
    sys.exit('two_machines: ' + text)


def ip(*words, check=True):
    subprocess.run(['ip', *words], check=check, stderr=None if check else subprocess.DEVNULL)


@contextlib.contextmanager
def link():
    """Two namespaces and a cable between them; yields what pulls it, and plugs it in."""
    robot, base = NAMES[ROBOT], NAMES[BASE]
    cable = 'cable%d' % (os.getpid() % 100000)
    try:
        for name in (robot, base):
            ip('netns', 'add', name)
            ip('-n', name, 'link', 'set', 'lo', 'up')
        ip('link', 'add', cable, 'netns', robot, 'type', 'veth', 'peer', 'name', cable, 'netns', base)
        for address, name in NAMES.items():
            ip('-n', name, 'addr', 'add', address + '/24', 'dev', cable)
            ip('-n', name, 'link', 'set', cable, 'up')
        yield lambda up: ip('-n', base, 'link', 'set', cable, 'up' if up else 'down')
    finally:
        for name in (robot, base):
            ip('netns', 'del', name, check=False)


class Machine:
    """What runs at an address."""

    def __init__(self, address, out):
        self.address, self.out, self.processes = address, out, []

    def start(self, log, *words):
        environment = dict(os.environ, ROS_MASTER_URI=MASTER, ROS_IP=self.address, PYTHONUNBUFFERED='1')
        environment.pop('ROS_HOSTNAME', None)
        with open(os.path.join(self.out, log), 'w') as file:
            process = subprocess.Popen(['ip', 'netns', 'exec', NAMES[self.address], *words], stdout=file,
                                       stderr=subprocess.STDOUT, env=environment, start_new_session=True)
        self.processes.append(process)
        return process

    def stop(self, process):
        """As Ctrl-C does."""
        if process.poll() is not None:
            return
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)

    def end(self):
        for process in reversed(self.processes):
            self.stop(process)


def logged(path, text):
    with open(path, errors='replace') as file:
        return text in file.read()


def wait_for(what, condition, seconds=120):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            fail(what + ' takes too long')
        time.sleep(0.2)


def stamps_of_edges(session):
    """How often each pair of stamps (ns) is there, of the robot's edges."""
    with contextlib.closing(sqlite3.connect('file:%s?mode=ro' % session, uri=True)) as database:
        stamps = dict(database.execute('SELECT id, stamp FROM key_poses'))
        return collections.Counter((stamps[start], stamps[end]) for start, end in database.execute(
            "SELECT from_id, to_id FROM edges WHERE source LIKE '%edges'"))


def newest_key_pose(session):
    try:
        with contextlib.closing(sqlite3.connect('file:%s?mode=ro' % session, uri=True)) as database:
            return 1e-9 * (database.execute('SELECT max(stamp) FROM key_poses').fetchone()[0] or 0)
    except sqlite3.Error:
        return 0.0


# Bytes that each topic's publishers have sent to other hosts, as the nodes' own statistics have it.
BUS = r'''
import collections, json, sys, xmlrpc.client
master = xmlrpc.client.ServerProxy(sys.argv[1])
_, _, (publishers, _, _) = master.getSystemState('two_machines')
uris = {node: master.lookupNode('two_machines', node)[2] for _, nodes in publishers for node in nodes}
hosts = {node: uri.split('//')[1].split(':')[0] for node, uri in uris.items()}
sent = collections.Counter()
for node, uri in uris.items():
    slave = xmlrpc.client.ServerProxy(uri)
    to = {entry[0]: entry[1] for entry in slave.getBusInfo('two_machines')[2] if entry[2] == 'o'}
    stats = slave.getBusStats('two_machines')
    for topic, *_, connections in stats[0] if isinstance(stats[0], list) else stats[2][0]:  # of roscpp, of rospy
        for connection in connections:
            if hosts.get(to.get(connection[0]), hosts[node]) != hosts[node]:
                sent[topic + ' ' + hosts[node]] += connection[1]
print(json.dumps(sent))
'''


def bytes_over_link():
    """Of each topic and sender."""
    done = subprocess.run(['ip', 'netns', 'exec', NAMES[ROBOT], '/usr/bin/python3', '-c', BUS, MASTER], check=True,
                          stdout=subprocess.PIPE, timeout=60)
    return collections.Counter(json.loads(done.stdout.decode()))


def main():
    parser = argparse.ArgumentParser(prog='two_machines.py', description=__doc__)
    parser.add_argument('seconds', type=float)
    parser.add_argument('--bag', required=True)
    parser.add_argument('--slam', required=True)
    parser.add_argument('--mapping', required=True)
    parser.add_argument('--out', required=True)
    a = parser.parse_args()
    session = os.path.join(a.out, 'base.session')
    for left in glob.glob(session + '*') + glob.glob(os.path.join(a.out, 'robot.bag*')):
        os.remove(left)
    with rosbag.Bag(a.bag) as bag:
        duration = bag.get_end_time() - bag.get_start_time()
    with link() as plug:
        robot, base = Machine(ROBOT, a.out), Machine(BASE, a.out)
        try:
            cut = trial(a, robot, base, plug, session, duration)
        finally:
            base.end()
            robot.end()
    judge(a, session, cut)


def trial(a, robot, base, plug, session, duration):
    """@return when the link was cut and plugged in (s), and when the base station had caught up"""
    core = robot.start('master.log', 'roscore', '-p', '11311')
    wait_for('the master', lambda: logged(os.path.join(a.out, 'master.log'), 'started core service'))
    with socket.socket() as s:
        s.bind(('', 0))
        port = s.getsockname()[1]
    calibration = os.path.join(os.getcwd(), 'laser_intensity_calib/config/reflectivity_hokuyo_utm30lx.yaml')
    robot.start('robot.log', 'roslaunch', 'launch/robot.launch', 'ip_address:=127.0.0.1', 'ip_port:=%d' % port,
                'odom_frame:=odom', 'slam_config:=' + a.slam, 'calibration:=' + calibration)
    wait_for('robot.launch', lambda: logged(os.path.join(a.out, 'robot.log'), 'process[slam-'))
    base.start('base.log', 'roslaunch', 'launch/base.launch', 'odom_frame:=odom', 'mapping_config:=' + a.mapping,
               'cloud:=velodyne_points', 'resolution:=0.1', 'place_recognition:=true', 'session_file:=' + session)
    wait_for('base.launch', lambda: logged(os.path.join(a.out, 'base.log'), 'process[pose_graph-'))
    recorder = robot.start('record.log', 'rosbag', 'record', '-O', os.path.join(a.out, 'robot.bag'), '/edges',
                           '/slam_out_pose')
    robot.start('emulator.log', 'rosrun', 'hokuyo_sick_drivers', 'hokuyo_emulator', '--tcp', str(port), '--topic',
                '/simulated_scan')
    time.sleep(5)
    play = robot.start('play.log', 'rosrun', 'mapping_simulation', 'play_live', a.bag, '--wait-for',
                       'camera/image_rect', 'scan:=simulated_scan')
    wait_for('the drive', lambda: newest_key_pose(session) > 0)
    start = time.time()
    begun = bytes_over_link()
    time.sleep(CUT_AT * duration)
    cut = time.time()
    plug(False)
    print('%.0f s: the link is cut; the base station is %.1f s behind' % (cut - start, time.time() - newest_key_pose(session)))
    time.sleep(a.seconds)
    plug(True)
    plugged = time.time()
    print('%.0f s: it is back; the base station is %.1f s behind' % (plugged - start, plugged - newest_key_pose(session)))
    wait_for('catching up', lambda: time.time() - newest_key_pose(session) < LAG)
    caught_up = time.time()
    print('%.0f s: the base station has caught up, %.1f s later' % (caught_up - start, caught_up - plugged))
    time.sleep(max(0.0, TABLE_AT * duration - (time.time() - start)))
    table(bytes_over_link(), begun, time.time() - start, os.path.join(a.out, 'bandwidth.csv'))
    wait_for('the drive', lambda: play.poll() is not None, 600)
    time.sleep(10)
    robot.stop(recorder)
    for name in ('robot', 'base'):
        if logged(os.path.join(a.out, name + '.log'), 'process has died'):
            fail('a process of the %s died, see %s.log' % (name, name))
    del core
    return cut, plugged, caught_up


def table(after, before, seconds, path):
    rows = sorted(((after[key] - before[key]) / seconds / 1e3, key) for key in after)
    with open(path, 'w') as file:
        file.write('topic,from,kB/s\n')
        for rate, key in reversed(rows):
            topic, sender = key.split()
            line = '%s,%s,%.1f' % (topic, 'robot' if sender == ROBOT else 'base station', rate)
            file.write(line + '\n')
            if rate >= 0.05:
                print(line)
    print('all,,%.1f' % sum(rate for rate, _ in rows))


def judge(a, session, cut):
    published, poses = collections.Counter(), []
    with rosbag.Bag(os.path.join(a.out, 'robot.bag')) as bag:
        for topic, message, stamp in bag.read_messages():
            if topic == '/edges':
                published[(message.from_stamp.to_nsec(), message.to_stamp.to_nsec())] += 1
            else:
                poses.append(stamp.to_sec())
    gap = max(later - earlier for earlier, later in zip(poses, poses[1:]) if cut[0] - 1 < later < cut[2] + 1)
    kept = stamps_of_edges(session)
    during = sum(1 for edge in published if cut[0] < 1e-9 * edge[1] < cut[1])
    lost = [edge for edge in published if edge not in kept]
    doubled = [edge for edge in published if kept[edge] > published[edge]]
    print('edges of the robot: %d, %d of them while the link was cut; lost %d, doubled %d'
          % (len(published), during, len(lost), len(doubled)))
    print('poses of the robot: %d, the longest gap around the cut %.3f s' % (len(poses), gap))
    with contextlib.closing(sqlite3.connect(session)) as database:
        without = database.execute('SELECT count(*) FROM key_poses WHERE id NOT IN '
                                   '(SELECT key_pose FROM data WHERE kind = 1)').fetchone()[0]
    print('key poses without a scan: %d of %d' % (without, len({end for _, end in kept}) + 1))
    if lost or doubled or during == 0 or gap > LONGEST_GAP:
        fail('see above')


if __name__ == '__main__':
    main()
