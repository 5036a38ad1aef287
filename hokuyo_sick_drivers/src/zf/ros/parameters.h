// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "hokuyo_sick_drivers/zf/scan_choice.h"

namespace hokuyo_sick_drivers {

/// What the reader of scan files is started with.
struct ZfReaderParameters {
  std::string file, scan = "1", wait_for;
  std::string frame_id = "scanner", parent_frame = "map";
  bool publish_tf = true, loop = false, latch = true;
  double rate = 1.0;
  ReadOptions reading;
  CloudOptions cloud;
  std::string offset = "auto";

  void describe(mapping_common::OptionList& o) {
    o("file", file, "",
      "path of an E57, PTX, PTS or ASC file, or of a folder: all of these in it, in the order of their "
      "names. "
      "The scanner's own .zfs and .zfc have to be exported to one of these first");
    o("scan", scan, "",
      "which scan of each file: a number from 1, a name, or all, one after the other, from when somebody "
      "subscribes");
    o("wait_for", wait_for, "",
      "services that have to be there before the first scan is published, any number with spaces or commas "
      "between "
      "them: of who mustn't miss one");
    o("frame_id", frame_id, "",
      "frame of the cloud; where there are several scans and publish_tf is true, each has its own, with _1, "
      "_2 "
      "... appended")
        .notEmpty();
    o("parent_frame", parent_frame, "", "registered frame that the scans' poses are in");
    o("publish_tf", publish_tf, "", "whether to publish the pose of frame_id in parent_frame (static)");
    o("rate", rate, "1/s", "of wall time, at which scans are published, at most")
        .within(0.001, 100.0)
        .dynamic();
    o("loop", loop, "", "whether to begin again after the last scan").dynamic();
    o("latch", latch, "",
      "whether who subscribes later gets the last cloud; holds another copy of it when looping");
    cloud.describe(o);
    o("offset", offset, "",
      "\"X Y Z\" in m is taken off all points, as they become floats; auto: only where they are beyond 10 "
      "km, rounded "
      "to km; none. The pose makes up for it");
    reading.describe(o);
    CloudOptions parsed;
    o.require(parseOffset(offset, parsed), "offset", "auto, none or \"X Y Z\"");
    o.require(!publish_tf || (!parent_frame.empty() && parent_frame != frame_id), "parent_frame",
              "a frame other than frame_id");
  }
};

}  // namespace hokuyo_sick_drivers
