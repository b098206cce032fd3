// As much of Arduino's interface as the sketch uses, on a computer: the serial port is standard
// input and output, and every change of a pin is a line "PIN LEVEL MILLISECONDS" on standard error.
#pragma once

#include <poll.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

const uint8_t LOW = 0;
const uint8_t HIGH = 1;
const uint8_t OUTPUT = 1;

inline unsigned long millis() {
  using namespace std::chrono;
  static const auto start = steady_clock::now();
  return duration_cast<milliseconds>(steady_clock::now() - start).count();
}

inline void delay(unsigned long ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

inline void pinMode(uint8_t, uint8_t) {}

inline void digitalWrite(uint8_t pin, uint8_t level) {
  std::fprintf(stderr, "%d %d %lu\n", pin, level, millis());
}

struct SerialPort {
  void begin(unsigned long) {}
  int available() {
    struct pollfd input = {0, POLLIN, 0};
    return poll(&input, 1, 1) > 0 ? 1 : 0;
  }
  int read() {
    unsigned char letter;
    if (::read(0, &letter, 1) != 1) std::exit(0);
    return letter;
  }
  void print(const char *text) {
    if (::write(1, text, std::strlen(text)) < 0) std::exit(1);
  }
};

static SerialPort Serial;
