// SPDX-License-Identifier: BSD-3-Clause
#include "pose_graph/key_sensors.h"

#include <algorithm>
#include <utility>

namespace pose_graph {
namespace {

constexpr std::size_t kMostWaiting = 1000;  // where stamps don't go on

}  // namespace

void KeySensors::add(DataKind kind, std::int64_t stamp, std::int64_t until, Encode encode) {
  std::deque<Item>& items = waiting_[kind];
  items.push_back({stamp, until, std::move(encode)});
  if (items.size() > kMostWaiting) items.pop_front();
}

void KeySensors::skip(std::size_t nodes) {
  for (std::size_t i = 0; i < nodes; ++i)
    for (const auto& choice : choicesOf(DataKind())) nodes_.insert({choice.value, i});
}

std::vector<KeyData> KeySensors::take(const OnlineGraph& graph) {
  const Trajectory& front_end = graph.frontEnd();
  std::vector<KeyData> picked;
  for (auto& [kind, items] : waiting_) {
    const std::int64_t hold = kind == DataKind::kScan ? hold_ : 0;
    std::int64_t newest = 0;
    for (const Item& item : items) newest = std::max(newest, item.stamp);
    std::deque<Item> left;
    for (Item& item : items) {
      const std::int64_t age = newest - item.stamp;
      auto at = graph.attach(item.stamp);
      const bool is_key_pose = at && graph.find(item.stamp).has_value();
      const bool moves_on = !front_end.empty() && front_end.last() < item.until;
      if ((!is_key_pose && age < hold) || ((!at || moves_on) && age < wait_)) {
        left.push_back(std::move(item));
        continue;
      }
      if (!at || !nodes_.insert({kind, at->node}).second) continue;
      KeyData data = item.encode(front_end);
      data.kind = kind;
      data.key_pose = graph.graph().nodes()[at->node].id;
      data.stamp = item.stamp;
      data.sensor = at->offset;
      picked.push_back(std::move(data));
    }
    items = std::move(left);
  }
  return picked;
}

}  // namespace pose_graph
