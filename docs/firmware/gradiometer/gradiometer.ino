// Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
// Reference sender: eight Hall channels and a chip temperature, 1000 frames a second.
//
// Wire the outputs Bx, Bz of pixels 0 to 3 to A0 to A7, or replace readSensor() by your converter's.
// 38 bytes at 1 kHz are 38000 bytes/s: native USB, or a UART of at least 380000 baud.

#include "tactile_frame.h"

const uint32_t kPeriodUs = 1000;
const uint32_t kBaud = 460800;
const uint8_t kBits = 12;                          // of the converter
const int16_t kMiddle = 1 << (kBits - 1);          // reading at no field
const uint8_t kPins[tactile::kChannels] = {A0, A1, A2, A3, A4, A5, A6, A7};

uint32_t sequence = 0;
uint32_t due = 0;

// Counts around 0; a converter at its end is sent as the limit, so that the host marks it.
void readSensor(int16_t counts[tactile::kChannels], int16_t *centidegrees) {
  for (uint8_t i = 0; i < tactile::kChannels; ++i) {
    const int16_t reading = (int16_t)analogRead(kPins[i]);
    counts[i] = (int16_t)(reading - kMiddle);
    if (reading <= 0) counts[i] = -32767;
    if (reading >= 2 * kMiddle - 1) counts[i] = 32767;
  }
  *centidegrees = tactile::kNoTemperature;         // or what the chip reports, times 100
}

void setup() {
  analogReadResolution(kBits);
  Serial.begin(kBaud);
  due = micros();
}

void loop() {
  const uint32_t now = micros();
  if ((int32_t)(now - due) < 0) return;
  due += kPeriodUs;
  if ((int32_t)(now - due) > 0) due = now + kPeriodUs;   // too late: do not send a burst

  int16_t counts[tactile::kChannels];
  int16_t centidegrees;
  readSensor(counts, &centidegrees);

  uint8_t frame[tactile::kFrameBytes];
  tactile::writeFrame(frame, counts, centidegrees, sequence++, now);
  // a frame is sent whole or not at all; the gap in the sequence tells the host
  if (Serial.availableForWrite() >= (int)sizeof frame) Serial.write(frame, sizeof frame);
}
