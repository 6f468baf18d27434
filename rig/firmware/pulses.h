// The pulse train: all outputs rise in one cycle; the frame outputs fall after the exposure, the event cameras' output
// after the width of its symbol. See PROTOCOL.md for the code.
#pragma once

#include <stdbool.h>
#include <stdint.h>

#include "clock.h"

#define FRAME_OUTPUTS 4
#define PERIOD_MIN 16000UL
#define PERIOD_MAX 0x10000000UL
#define EXPOSURE_MIN 320UL
#define EXPOSURE_GUARD 800UL

typedef struct {
  uint32_t index;
  tick_t tick;
  uint32_t width;
} pulse_t;

typedef struct {
  uint32_t period, exposure;
  uint8_t outputs;
} settings_t;

void pulses_init(void);

settings_t pulses_settings(void);
// The caller has checked the ranges.
void pulses_configure(settings_t settings);

bool pulses_running(void);
// The tick of the first rising edge. Only while not running.
tick_t pulses_start(void);
// No further pulse begins; `pulses_running` says when the last one is complete.
void pulses_stop(void);

uint32_t pulses_count(void);
uint32_t pulses_late(void);
// Pulses whose report found no room.
uint32_t pulses_lost(void);
// Whether there is a pulse to report; takes the oldest.
bool pulses_pending(void);
bool pulses_take(pulse_t *pulse);
