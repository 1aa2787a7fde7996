// Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
// The sketch until it has sent twenty frames.
#include "Arduino.h"
#include "gradiometer.ino"
int main() {
  setup();
  while (sequence < 20) loop();
}
