// The sketch until it has sent twenty frames.
#include "Arduino.h"
#include "gradiometer.ino"
int main() {
  setup();
  while (sequence < 20) loop();
}
