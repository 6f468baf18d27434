// The board's clock: timer 1 counts processor cycles from reset on; overflows are counted to 48 bits.
#pragma once

#include <stdint.h>

// 48 bits of ticks. (A 64-bit integer would cost every interrupt handler eight registers.)
typedef struct {
  uint32_t low;
  uint16_t high;
} tick_t;

static inline tick_t tick_plus(tick_t tick, uint32_t ticks) {
  tick.low += ticks;
  tick.high += tick.low < ticks;
  return tick;
}

void clock_init(void);

// The tick now. Interrupts must be off.
tick_t clock_now(void);
