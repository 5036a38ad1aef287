#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Drives the whole robot twice: with all nodelets in one manager, for the time from each scan's arrival to that of its pose,
and with a process for each, for the processor time that they take.

Run by scripts/latency.
"""
import argparse
import contextlib
import glob
import os
import re
import struct
import threading
import time

import rospy
from live_robot import Robot, duration_of, fail, ours
from mapping_msgs.srv import SaveMap

LIMIT = 25.0    # ms, from scan to pose, of 99 %
SAVE_AT = 0.75  # share of the drive
MADE = re.compile(r'\[(\d+\.\d+)\]: Made anew: .* in ([0-9.e+-]+) s')


def stamp_of(message):
    """Of the header that a message begins with."""
    return struct.unpack_from('<II', message._buff, 4)


class Listener:
    """When scans and poses arrive, by their stamps. Here both come over TCP and into Python, so that what is measured is
    more than what a nodelet in the same manager would see."""

    def __init__(self):
        self.lock, self.scans, self.latencies = threading.Lock(), {}, []
        rospy.Subscriber('scan', rospy.AnyMsg, self.scan, queue_size=100)
        rospy.Subscriber('slam_out_pose', rospy.AnyMsg, self.pose, queue_size=100)

    def scan(self, message):
        with self.lock:
            self.scans[stamp_of(message)] = time.time()

    def pose(self, message):
        now = time.time()
        with self.lock:
            came = self.scans.pop(stamp_of(message), None)
            if came is not None:
                self.latencies.append((came, now - came))


def quantiles(latencies):
    ordered = sorted(1e3 * latency for _, latency in latencies)
    if not ordered:
        return 'no scan'
    return '%d scans: median %.1f ms, 99 %% %.1f ms, greatest %.1f ms' % (
        len(ordered), ordered[len(ordered) // 2], ordered[int(0.99 * len(ordered))], ordered[-1])


def new_session(folder, name):
    path = os.path.join(os.path.abspath(folder), name + '.session')
    for left in glob.glob(path + '*'):  # the write-ahead log, too
        os.remove(left)
    return path


@contextlib.contextmanager
def started(a, name, manager):
    robot = Robot(os.path.join(a.out, name), new_session(a.out, name), a.slam, a.mapping, 'manager:=' + manager,
                  'pose_graph_config:=' + a.pose_graph)
    try:
        robot.start()
        yield robot
        robot.stop()
        if robot.died():
            fail(robot.died()[0].strip())
    finally:
        robot.end()


def measure_latency(a, seconds):
    """@return (time of arrival, time from scan to pose), s"""
    with started(a, 'together', 'manager') as robot:
        rospy.init_node('latency', anonymous=True, disable_signals=True)
        listener = Listener()
        drive = robot.play(a.bag)
        time.sleep(SAVE_AT * seconds)
        begin = time.time()
        answer = rospy.ServiceProxy('pose_graph/save', SaveMap)(path=new_session(a.out, 'copy'))
        saved = (begin, time.time())
        if not answer.success:
            fail('the session is not saved: ' + answer.message)
        drive.wait()
        # The last scans wait for odometry that doesn't come any more.
        latencies = [entry for entry in listener.latencies if entry[0] < listener.latencies[-1][0] - 2.0]
        with open(robot.log, errors='replace') as file:
            rebuilt = [(float(end) - float(took), float(end)) for end, took in MADE.findall(file.read())]
    with open(os.path.join(a.out, 'latencies.csv'), 'w') as out:
        out.write('scan (s),to its pose (ms)\n')
        for came, latency in latencies:
            out.write('%.3f,%.2f\n' % (came - latencies[0][0], 1e3 * latency))
    during = lambda windows: [entry for entry in latencies if any(begin <= entry[0] <= end for begin, end in windows)]
    print('from scan to pose, ' + quantiles(latencies))
    print('while maps were made anew (%d times, %.1f s in all), ' % (len(rebuilt), sum(end - begin for begin, end in rebuilt)) +
          quantiles(during(rebuilt)))
    print('while the session was saved (%.2f s), ' % (saved[1] - saved[0]) + quantiles(during([saved])), flush=True)
    return latencies


def processor_times():
    """s, of each nodelet's process."""
    times = {}
    for process, words in ours():
        if words[0].endswith(b'/nodelet') and words[1:2] == [b'standalone']:
            with open('/proc/%d/stat' % process) as file:
                fields = file.read().rsplit(')', 1)[1].split()
            times[words[2].decode()] = (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
    return times


def measure_processors(a):
    with started(a, 'apart', 'none') as robot:
        drive = robot.play(a.bag)
        before, begin = processor_times(), time.monotonic()
        drive.wait()
        after, seconds = processor_times(), time.monotonic() - begin
    with open(os.path.join(a.out, 'processors.csv'), 'w') as out:
        for line in ['nodelet,% of a core'] + [
                '%s,%.1f' % (name, 100.0 * (spent - before.get(name, 0.0)) / seconds)
                for name, spent in sorted(after.items(), key=lambda item: -item[1])]:
            print(line)
            out.write(line + '\n')


def main():
    parser = argparse.ArgumentParser(prog='latency.py', description=__doc__)
    parser.add_argument('--bag', required=True)
    parser.add_argument('--slam', required=True)
    parser.add_argument('--mapping', required=True)
    parser.add_argument('--pose-graph', required=True)
    parser.add_argument('--out', required=True)
    a = parser.parse_args()
    latencies = sorted(latency for _, latency in measure_latency(a, duration_of(a.bag)))
    measure_processors(a)
    if not latencies or 1e3 * latencies[int(0.99 * len(latencies))] > LIMIT:
        fail('of 99 %% of the scans, the pose should come within %.0f ms' % LIMIT)


if __name__ == '__main__':
    main()
