#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Drives the whole robot round after round, breaks what breaks in the field, and looks at memory and at the session.

Run by scripts/soak --robot. In each round something else goes wrong: the scanner goes away, all nodes are killed, the clock of
what is replayed jumps, the disk of the session is full. What a round needs afterwards must be there again, nothing but
what was killed may end, memory may grow by what is kept for good alone, and at last the session has to be whole.
"""
import argparse
import contextlib
import glob
import os
import shutil
import sqlite3
import subprocess
import tempfile
import time

from live_robot import Robot, duration_of, fail

# MB a round that the nodes may grow by: what is kept for good of key poses, places and images, and what the C library doesn't
# give back of what was freed, which varies.
KEPT = 60.0
ROUND_LIMIT = 600  # s


def key_poses(session):
    with contextlib.closing(sqlite3.connect('file:%s?mode=ro' % session, uri=True)) as database:
        return database.execute('SELECT count(*) FROM key_poses').fetchone()[0]


@contextlib.contextmanager
def small_disk(megabytes):
    """A folder on a disk of its own, which may be filled; None where that needs rights that aren't there."""
    folder = tempfile.mkdtemp(prefix='soak_')
    mounted = subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=%dM' % megabytes, 'soak', folder], check=False,
                             stderr=subprocess.DEVNULL).returncode == 0
    try:
        yield folder if mounted else None
    finally:
        if mounted:
            subprocess.run(['umount', '-l', folder], check=False)
        shutil.rmtree(folder, ignore_errors=True)


def fill(folder):
    """@return the file that takes what is free"""
    path = os.path.join(folder, 'filler')
    with open(path, 'wb') as file:
        with contextlib.suppress(OSError):
            while True:
                file.write(b'\0' * 65536)
                file.flush()
    return path


def drive(robot, bag, seconds, fault=None, at=0.4, options=()):
    """One round. @param fault is called when a part of the round is over"""
    play = robot.play(bag, *options)
    begin = time.monotonic()
    while play.poll() is None:
        time.sleep(0.5)
        passed = time.monotonic() - begin
        if fault and passed > at * seconds:
            fault()
            fault = None
        if passed > ROUND_LIMIT:
            play.kill()
            fail('a round does not end')
    if play.returncode != 0:
        fail('the replay failed, see play.log')


def main():
    parser = argparse.ArgumentParser(prog='soak_robot.py', description=__doc__)
    parser.add_argument('minutes', type=float)
    parser.add_argument('--bag', required=True)
    parser.add_argument('--slam', required=True)
    parser.add_argument('--mapping', required=True)
    parser.add_argument('--out', required=True)
    a = parser.parse_args()
    seconds = duration_of(a.bag)
    with small_disk(1024) as disk:
        session = os.path.join(disk or a.out, 'soak.session')
        if disk is None:
            for left in glob.glob(session + '*'):  # the write-ahead log, too
                os.remove(left)
        soak(a, Robot(a.out, session, a.slam, a.mapping), seconds, disk)


def soak(a, robot, seconds, disk):
    def restart_scanner():
        robot.stop_emulator()
        time.sleep(5)
        robot.start_emulator()

    def restart_nodes():
        robot.kill()
        robot.start()

    def full_disk():
        filler = fill(disk)
        time.sleep(20)
        os.remove(filler)

    faults = [('nothing', None, ()), ('nodes killed', restart_nodes, ()), ('scanner restarted', restart_scanner, ()),
              ('stamps 3 s early', None, ('--early', '3'))]
    if disk:
        faults.append(('disk full for 20 s', full_disk, ()))
    else:
        print('No disk of its own can be mounted here: it is not filled')
    stop = time.monotonic() + 60 * a.minutes
    rounds, memory, poses, growing = 0, [], 0, []
    try:
        robot.start()
        while time.monotonic() < stop or rounds <= len(faults):
            # After each fault has come twice, undisturbed rounds tell whether memory still grows.
            name, fault, options = faults[rounds % len(faults)] if rounds < len(faults) * 2 else faults[0]
            drive(robot, a.bag, seconds, fault, options=options)
            rounds += 1
            if robot.manager() is None:
                fail('round %d, %s: the nodes ended, see %s' % (rounds, name, robot.log))
            if robot.died():
                fail('round %d, %s: %s' % (rounds, name, robot.died()[0].strip()))
            before, poses = poses, key_poses(robot.session)
            if poses < before + 20:
                fail('round %d, %s: only %d new key poses' % (rounds, name, poses - before))
            if fault is restart_nodes:
                memory = []
            memory.append(robot.memory())
            growing = [later - earlier for earlier, later in zip(memory, memory[1:])]
            print('round %d, %s: %d key poses, nodes %.0f MB' % (rounds, name, poses, memory[-1]), flush=True)
        robot.stop()
        robot.stop_emulator()
        check = subprocess.run(['rosrun', 'pose_graph', 'pose_graph', 'info', robot.session], stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, universal_newlines=True, check=False)
        print(check.stdout)
        if check.returncode != 0:
            fail('the session cannot be read')
        with contextlib.closing(sqlite3.connect(robot.session)) as database:
            said = database.execute('PRAGMA integrity_check').fetchone()[0]
        if said != 'ok':
            fail('the session is damaged: ' + said)
    finally:
        robot.end()
    last = sorted(growing[len(growing) // 2:])
    grown = last[len(last) // 2] if last else 0.0
    print('%d rounds; the nodes grow by %.1f MB a round' % (rounds, grown))
    if grown > KEPT:
        fail('memory grows by more than the %.0f MB a round that are kept for good' % KEPT)


if __name__ == '__main__':
    main()
