#include "clock.h"

#include <avr/interrupt.h>
#include <avr/io.h>

static volatile uint32_t wraps;

void clock_init(void) {
  TCCR1A = 0;
  TCCR1B = _BV(CS10);  // No prescaler, no waveform: a free-running counter.
  TIMSK1 = _BV(TOIE1);
}

tick_t clock_now(void) {
  uint16_t count = TCNT1;
  uint32_t full = wraps;
  // An overflow whose interrupt is still to come: only if the counter was read after it.
  if ((TIFR1 & _BV(TOV1)) && count < 0x8000) full++;
  return (tick_t){.low = full << 16 | count, .high = full >> 16};
}

ISR(TIMER1_OVF_vect) { wraps++; }
