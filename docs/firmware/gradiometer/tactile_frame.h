// Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
// One frame of the serial protocol, version 1, for a gradiometer (docs/serial_protocol.md).
// Plain C++11 without dynamic memory or Arduino calls: 38 bytes of the caller's, 64 of a table.

#ifndef TACTILE_FRAME_H
#define TACTILE_FRAME_H

#include <stddef.h>
#include <stdint.h>

namespace tactile {

const uint8_t kVersion = 1;
const uint8_t kGradiometer = 1;
const uint8_t kPixels = 4;
const uint8_t kChannels = 2 * kPixels;
const uint8_t kPayloadBytes = 2 * kChannels + 2;
const size_t kFrameBytes = 16 + kPayloadBytes + 4;
const int16_t kNoTemperature = -32768;

// CRC-32 of zlib, four bits at a time: a table of 64 bytes instead of 1024.
inline uint32_t crc32(const uint8_t *data, size_t count) {
  static const uint32_t table[16] = {
      0x00000000, 0x1DB71064, 0x3B6E20C8, 0x26D930AC, 0x76DC4190, 0x6B6B51F4,
      0x4DB26158, 0x5005713C, 0xEDB88320, 0xF00F9344, 0xD6D6A3E8, 0xCB61B38C,
      0x9B64C2B0, 0x86D3D2D4, 0xA00AE278, 0xBDBDF21C};
  uint32_t crc = 0xFFFFFFFFu;
  for (size_t i = 0; i < count; ++i) {
    crc ^= data[i];
    crc = (crc >> 4) ^ table[crc & 15];
    crc = (crc >> 4) ^ table[crc & 15];
  }
  return ~crc;
}

// Little-endian on any processor.
inline uint8_t *put16(uint8_t *to, uint16_t value) {
  *to++ = (uint8_t)value;
  *to++ = (uint8_t)(value >> 8);
  return to;
}

inline uint8_t *put32(uint8_t *to, uint32_t value) {
  return put16(put16(to, (uint16_t)value), (uint16_t)(value >> 16));
}

// Write one frame.
//   counts       Bx, Bz of pixels 0 to 3
//   centidegrees chip temperature in 0.01 degrees Celsius, or kNoTemperature
//   sequence     one more with every frame, also with those that could not be sent
//   time_us      when the sample was taken
inline void writeFrame(uint8_t frame[kFrameBytes], const int16_t counts[kChannels],
                       int16_t centidegrees, uint32_t sequence, uint32_t time_us) {
  uint8_t *to = frame;
  *to++ = 0xA5;
  *to++ = 0x5A;
  *to++ = kVersion;
  *to++ = kGradiometer;
  to = put16(to, kPixels);
  to = put16(to, kPayloadBytes);
  to = put32(to, sequence);
  to = put32(to, time_us);
  for (uint8_t i = 0; i < kChannels; ++i) to = put16(to, (uint16_t)counts[i]);
  to = put16(to, (uint16_t)centidegrees);
  put32(to, crc32(frame, (size_t)(to - frame)));
}

}  // namespace tactile

#endif  // TACTILE_FRAME_H
