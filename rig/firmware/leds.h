// The wand's three LEDs on A0 to A2: each dark, lit, or toggled every so many units of 1600 ticks (100 µs).
#pragma once

#include <stdint.h>

#define LEDS 3

void leds_init(void);
void leds_set(const uint16_t half_periods[LEDS]);
