# SPDX-License-Identifier: BSD-3-Clause
"""The whole robot, live, in the simulated building: robot.launch, an emulated scanner, and a recording that is replayed. For
scripts that measure it, or break it."""
import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time


def fail(text):
    sys.exit('%s: %s' % (os.path.basename(sys.argv[0]), text))


class Robot:
    """roslaunch, the emulated scanner, and what is known of them."""

    def __init__(self, here, session, slam, mapping, *options):
        """@param here folder of logs, which is made  @param options more arguments of robot.launch"""
        os.makedirs(here, exist_ok=True)
        self.here, self.session, self.slam, self.mapping, self.options = here, session, slam, mapping, options
        self.port = free_port()
        self.logs = 0
        self.launch = self.emulator = None

    def start(self):
        """Starts all nodes, waits until the last of them has been started, and then starts the scanner, if it is off."""
        self.logs += 1
        self.log = os.path.join(self.here, 'robot_%d.log' % self.logs)
        workspace = os.getcwd()
        arguments = ['ip_address:=127.0.0.1', 'ip_port:=%d' % self.port, 'odom_frame:=odom', 'slam_config:=' + self.slam,
                     'calibration:=%s/laser_intensity_calib/config/reflectivity_hokuyo_utm30lx.yaml' % workspace,
                     'mapping:=true', 'mapping_config:=' + self.mapping, 'cloud:=velodyne_points', 'resolution:=0.1',
                     'loop_closure:=true', 'place_recognition:=true', 'pose_graph:=true', 'session_file:=' + self.session,
                     *self.options]
        with open(self.log, 'w') as out:
            self.launch = subprocess.Popen(['roslaunch', '--port', master_port(), 'launch/robot.launch'] + arguments, stdout=out,
                                           stderr=subprocess.STDOUT)
        self.wait_for('process\\[pose_graph-.*started')
        if self.emulator is None:
            self.start_emulator()

    def wait_for(self, text):
        """In the nodes' log."""
        for _ in range(120):
            time.sleep(0.5)
            with open(self.log, errors='replace') as file:
                if re.search(text, file.read()):
                    return
        fail('the nodes do not start, see ' + self.log)

    def start_emulator(self):
        with open(os.path.join(self.here, 'emulator.log'), 'a') as out:
            self.emulator = subprocess.Popen(['rosrun', 'hokuyo_sick_drivers', 'hokuyo_emulator', '--tcp', str(self.port),
                                              '--topic', '/simulated_scan'], stdout=out, stderr=subprocess.STDOUT)

    def stop_emulator(self):
        end(self.emulator, signal.SIGKILL)
        self.emulator = None

    def manager(self):
        """The process with all nodelets, or None."""
        found = [process for process, words in ours() if words[0].endswith(b'/nodelet') and words[1:2] == [b'manager']]
        return found[0] if found else None

    def memory(self):
        """Of the manager, MB: the least of some time, in which maps may be made anew."""
        def now():
            with open('/proc/%d/status' % self.manager()) as file:
                return int(re.search(r'VmRSS:\s*(\d+) kB', file.read()).group(1)) / 1024.0
        return min((now(), time.sleep(0.5))[0] for _ in range(50))

    def kill(self):
        """As a power cut does, but for the master."""
        end(self.launch, signal.SIGKILL)
        for process, words in ours():
            if words[0].endswith(b'/nodelet'):
                with contextlib.suppress(OSError):
                    os.kill(process, signal.SIGKILL)
        self.launch = None

    def end(self):
        """As kill, but of all, the master, too."""
        self.kill()
        for process, _ in ours():
            with contextlib.suppress(OSError):
                os.kill(process, signal.SIGKILL)

    def stop(self):
        """As Ctrl-C does."""
        end(self.launch, signal.SIGINT)
        self.launch = None

    def play(self, bag, *options):
        """@return the process that replays it"""
        with open(os.path.join(self.here, 'play.log'), 'w') as out:
            return subprocess.Popen(['rosrun', 'mapping_simulation', 'play_live', bag, '--wait-for', 'camera/image_rect',
                                     *options, 'scan:=simulated_scan'], stdout=out, stderr=subprocess.STDOUT)

    def died(self):
        """What roslaunch says of processes that ended by themselves."""
        with open(self.log, errors='replace') as file:
            return [line for line in file if 'process has died' in line]


def ours():
    """Processes of this robot's master but this one, and their words."""
    master = re.compile(rb'(^|\0)ROS_MASTER_URI=http://[^:]*:%s/?\0' % master_port().encode())
    for process in filter(str.isdigit, os.listdir('/proc')):
        with contextlib.suppress(OSError):
            with open('/proc/%s/environ' % process, 'rb') as file:
                if not master.search(file.read()) or int(process) in (os.getpid(), os.getppid()):
                    continue
            with open('/proc/%s/cmdline' % process, 'rb') as file:
                yield int(process), file.read().split(b'\0')


def master_port():
    return os.environ['ROS_MASTER_URI'].rstrip('/').rsplit(':', 1)[1]


def free_port():
    with socket.socket() as s:
        s.bind(('', 0))
        return s.getsockname()[1]


def end(process, kind):
    if process is None or process.poll() is not None:
        return
    process.send_signal(kind)
    try:
        process.wait(60)
    except subprocess.TimeoutExpired:
        fail('%s does not end' % process.args[0])


def duration_of(bag):
    import rosbag
    with rosbag.Bag(bag) as file:
        return file.get_end_time() - file.get_start_time()
