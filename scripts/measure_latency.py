#!/usr/bin/python3
# SPDX-License-Identifier: BSD-3-Clause
"""Subscribes to all that MappingNodelet publishes; prints what came, and the time from each cloud to the first update
that has it, when it is interrupted.

    measure_latency.py CLOUD_TOPIC
"""
import argparse
import struct
import threading
import time

import rospy

TOPICS = ("occupied_cells_vis_array", "free_cells_vis_array", "occupied_cells_centers", "occupied_cells_centers_updates",
          "projected_map", "projected_map_updates", "octomap_binary", "octomap_full")


def stamp_of(message):
    """Of the header that a message begins with."""
    return struct.unpack_from("<II", message._buff, 4)


class Listener:
    """Notes when clouds and updates arrive."""

    def __init__(self, cloud_topic):
        self.lock = threading.Lock()
        self.waiting, self.latencies = {}, []
        self.received = {topic: [0, 0] for topic in TOPICS}
        for topic in TOPICS:
            rospy.Subscriber(topic, rospy.AnyMsg, self.heard, topic, queue_size=100, buff_size=1 << 26)
        rospy.Subscriber(cloud_topic, rospy.AnyMsg, self.cloud, queue_size=100, buff_size=1 << 26)

    def cloud(self, message):
        with self.lock:
            self.waiting[stamp_of(message)] = time.monotonic()

    def heard(self, message, topic):
        now = time.monotonic()
        with self.lock:
            self.received[topic][0] += 1
            self.received[topic][1] += len(message._buff)
            if topic == "occupied_cells_centers_updates":
                shown = [stamp for stamp in self.waiting if stamp <= stamp_of(message)]
                self.latencies += [now - self.waiting.pop(stamp) for stamp in shown]

    def report(self):
        for topic, (messages, size) in self.received.items():
            print(f"{topic:32} {messages:5} messages, {size / 1e6:8.1f} MB")
        if self.latencies:
            latencies = sorted(self.latencies)
            median = latencies[len(latencies) // 2]
            print(f"From cloud to published change, {len(latencies)} clouds: median {1e3 * median:.0f} ms, "
                  f"greatest {1e3 * latencies[-1]:.0f} ms; {len(self.waiting)} clouds weren't published")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cloud_topic", metavar="CLOUD_TOPIC")
    arguments = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node("measure_latency", anonymous=True)
    listener = Listener(arguments.cloud_topic)
    rospy.spin()
    listener.report()
