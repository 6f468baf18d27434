#include "leds.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#define DARK 0
#define LIT 0xffff

static uint16_t half_period[LEDS], left[LEDS];

void leds_init(void) {
  PORTC = 0;
  DDRC = _BV(LEDS) - 1;
  TCCR0A = _BV(WGM01);             // Clear on compare match,
  TCCR0B = _BV(CS01) | _BV(CS00);  // 16 MHz / 64 = 250 kHz,
  OCR0A = 24;                      // every 25 counts: 10 kHz.
}

void leds_set(const uint16_t half_periods[LEDS]) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    uint8_t lit = 0, toggling = 0;
    for (uint8_t i = 0; i < LEDS; i++) {
      left[i] = half_period[i] = half_periods[i];
      lit |= half_periods[i] != DARK ? _BV(i) : 0;
      toggling |= half_periods[i] != DARK && half_periods[i] != LIT;
    }
    // All that toggle begin lit and together.
    PORTC = lit;
    TCNT0 = 0;
    TIFR0 = _BV(OCF0A);
    TIMSK0 = toggling ? _BV(OCIE0A) : 0;
  }
}

ISR(TIMER0_COMPA_vect) {
  uint8_t toggled = 0;
  for (uint8_t i = 0; i < LEDS; i++) {
    if (half_period[i] == DARK || half_period[i] == LIT || --left[i]) continue;
    left[i] = half_period[i];
    toggled |= _BV(i);
  }
  PINC = toggled;  // Ones written to PINC toggle the outputs.
}
