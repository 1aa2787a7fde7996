// Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
// What the sketch asks of an Arduino, on the host: time passes by calls, bytes go to stdout.
#ifndef ARDUINO_H
#define ARDUINO_H
#include <stdint.h>
#include <stdio.h>

enum { A0, A1, A2, A3, A4, A5, A6, A7 };

inline uint32_t micros() {
  static uint32_t now = 4294960000u;  // wraps after a few frames
  return now += 250;
}

inline void analogReadResolution(int) {}
inline int analogRead(uint8_t pin) { return pin == 7 ? 4095 : 2048 + 100 * pin; }

struct Port {
  int refused = 0;
  void begin(uint32_t) {}
  int availableForWrite() { return ++refused == 5 ? 37 : 64; }
  size_t write(const uint8_t *data, size_t count) { return fwrite(data, 1, count, stdout); }
};
static Port Serial;
#endif
