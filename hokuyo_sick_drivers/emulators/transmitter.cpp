// SPDX-License-Identifier: BSD-3-Clause
#include "transmitter.h"

#include <algorithm>
#include <utility>

namespace device_emulators {
namespace {

// A serial line hands over what came within this time, as the FIFO of a UART does.
constexpr Nanoseconds kFifo = kMillisecond;

}  // namespace

Nanoseconds Transmitter::duration(std::size_t bytes) const {
  if (options_.baud_rate <= 0) return 0;
  return static_cast<Nanoseconds>(bytes) * 10 * kSecond / options_.baud_rate;
}

void Transmitter::send(const std::string& message, Nanoseconds now, bool is_scan,
                       std::shared_ptr<const SentScan> scan) {
  const Nanoseconds late =
      options_.jitter > 0 ? std::uniform_int_distribution<Nanoseconds>(0, options_.jitter)(random_) : 0;
  const Nanoseconds start = std::max(free_at_, now + late);
  const std::size_t fifo =
      options_.baud_rate > 0 ? std::max<std::size_t>(options_.baud_rate / 10 * kFifo / kSecond, 1) : 0;
  Nanoseconds gaps = 0;
  for (std::size_t sent = 0; sent < message.size();) {
    std::size_t size = message.size() - sent;
    if (options_.packet_size > 0) {
      const std::size_t packet = options_.random_packets ? std::uniform_int_distribution<std::size_t>(
                                                               1, options_.packet_size)(random_)
                                                         : options_.packet_size;
      size = std::min(size, packet);
    }
    if (fifo > 0) size = std::min(size, fifo);
    Piece piece;
    piece.bytes = message.substr(sent, size);
    piece.starts_message = sent == 0;
    sent += size;
    piece.due = start + duration(sent) + gaps;
    piece.baud_rate = options_.baud_rate;
    piece.is_scan = is_scan;
    if (sent == message.size()) piece.completes = scan;
    gaps += options_.packet_gap;
    free_at_ = piece.due;
    pieces_.push_back(std::move(piece));
  }
  backlog_ += message.size();
}

void Transmitter::hold(Nanoseconds now, Nanoseconds until) {
  const auto first =
      std::find_if(pieces_.begin(), pieces_.end(), [&](const Piece& p) { return p.due > now; });
  if (first != pieces_.end()) {
    const Nanoseconds delay = until - first->due;
    if (delay > 0)
      for (auto piece = first; piece != pieces_.end(); ++piece) piece->due += delay;
    free_at_ = pieces_.back().due;
  }
  free_at_ = std::max(free_at_, until);
}

Transmitter::Piece Transmitter::take(Nanoseconds now) {
  if (deadline() > now) return {};
  Piece piece = std::move(pieces_.front());
  pieces_.pop_front();
  backlog_ -= piece.bytes.size();
  return piece;
}

void Transmitter::reschedule(Nanoseconds now) {
  free_at_ = pieces_.empty() ? now : std::max(now, pieces_.back().due);
  backlog_ = 0;
  for (const Piece& piece : pieces_) backlog_ += piece.bytes.size();
}

void Transmitter::cut(Nanoseconds now) {
  while (!pieces_.empty() && pieces_.back().is_scan && pieces_.back().due > now) pieces_.pop_back();
  reschedule(now);
}

void Transmitter::dropAfter(Nanoseconds now) {
  while (!pieces_.empty() && pieces_.back().due > now) pieces_.pop_back();
  reschedule(now);
}

void Transmitter::cutAfterLine(Nanoseconds now) {
  std::deque<Piece> kept;
  bool dropping = false;  // the rest of a message whose line is finished, or all of one not begun
  for (Piece& piece : pieces_) {
    if (piece.due > now && piece.is_scan) {
      if (piece.starts_message) dropping = true;
      if (dropping) continue;
      const std::size_t line_end = piece.bytes.find('\n');
      if (line_end != std::string::npos) {
        piece.bytes.resize(line_end + 1);
        piece.completes = nullptr;
        dropping = true;
      }
    } else if (piece.starts_message) {
      dropping = false;
    }
    kept.push_back(std::move(piece));
  }
  pieces_ = std::move(kept);
  reschedule(now);
}

void Transmitter::clear() {
  pieces_.clear();
  free_at_ = 0;
  backlog_ = 0;
}

}  // namespace device_emulators
