// Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
// Frames of the counts, times and temperatures that come in lines.
#include <stdio.h>
#include "tactile_frame.h"
int main() {
  int counts[tactile::kChannels], centidegrees;
  unsigned sequence, time_us;
  while (scanf("%d %u %u", &centidegrees, &sequence, &time_us) == 3) {
    int16_t narrow[tactile::kChannels];
    for (int i = 0; i < tactile::kChannels; ++i) {
      if (scanf("%d", &counts[i]) != 1) return 1;
      narrow[i] = (int16_t)counts[i];
    }
    uint8_t frame[tactile::kFrameBytes];
    tactile::writeFrame(frame, narrow, (int16_t)centidegrees, sequence, time_us);
    fwrite(frame, 1, sizeof frame, stdout);
  }
}
