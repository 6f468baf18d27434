#include "pulses.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

// Port B: D8 is the event cameras' output, D9 to D12 are frame outputs 1 to 4, D13 (the LED on the board) shows that
// the train runs. One `out` instruction moves them all.
#define EVENTS _BV(PB0)
#define FRAMES(mask) ((mask) << PB1)
#define RUNNING _BV(PB5)

// The interrupt comes so many cycles before an edge: more than any other handler and its own prologue take.
#define LEAD 400
// Edges nearer than this to the end of the handler are waited for in it.
#define STAY (LEAD + 150)
// A compare match nearer than this might pass while it is being set.
#define MATCH_MARGIN 100
// Edges nearer than this to one another leave no time for anything between them.
#define NEAR 512
// An edge is late if fewer cycles than this are left when its turn comes.
#define LATEST 48
// The event cameras' line falls with the frame triggers if it would fall nearer than this to them.
#define TOGETHER 160
#define START_AHEAD 32000

#define MARK 16
#define SYMBOL_BASE 1280U
#define SYMBOL_STEP 640U

#define REPORTS 8  // A power of two.

static settings_t settings = {.period = 533333, .exposure = 80000, .outputs = _BV(FRAME_OUTPUTS) - 1};

enum { IDLE, RISE, FALL, LAST_FALL };
static volatile uint8_t next_edge = IDLE;
static volatile bool stopping;
static volatile uint32_t count;
static volatile uint32_t late, lost;

// The pulse under way or to come, as it was when it was prepared.
static struct {
  tick_t rise;
  uint32_t period, exposure;
  uint32_t fall;       // Ticks from the rise to the first fall.
  uint32_t last_fall;  // Ticks from the rise to the last fall.
  uint8_t high, middle;
} pulse;
static uint16_t edge_at;     // Low bits of the tick of the next edge.
static uint16_t wraps_left;  // Compare matches to let pass before it.

static pulse_t reports[REPORTS];
static volatile uint8_t reports_in, reports_out;

void pulses_init(void) {
  PORTB = 0;
  DDRB = EVENTS | FRAMES(_BV(FRAME_OUTPUTS) - 1) | RUNNING;
}

static uint8_t symbol(uint32_t index) {
  uint8_t position = index & 7;
  if (position == 0) return MARK;
  index >>= 3;
  uint8_t byte[3] = {index >> 16, index >> 8, index};
  uint8_t check = 0;
  for (uint8_t i = 1; i <= 6; i++) {
    uint8_t digits = byte[(i - 1) >> 1];
    uint8_t digit = i & 1 ? digits >> 4 : digits & 15;
    if (i == position) return digit;
    check += (2 * i - 1) * digit;
  }
  return check & 15;
}

// Decides the falling edges of the pulse that rises at `pulse.rise`.
static void prepare(void) {
  pulse.period = settings.period;
  pulse.exposure = settings.exposure;
  uint8_t frames = FRAMES(settings.outputs);
  uint32_t width = SYMBOL_BASE + SYMBOL_STEP * symbol(count);
  uint32_t exposure = pulse.exposure;
  if (frames == 0 || (width + TOGETHER > exposure && exposure + TOGETHER > width)) {
    if (frames) width = exposure;
    pulse.fall = pulse.last_fall = width;
  } else if (width < exposure) {
    pulse.fall = width;
    pulse.last_fall = exposure;
    pulse.middle = RUNNING | frames;
  } else {
    pulse.fall = exposure;
    pulse.last_fall = width;
    pulse.middle = RUNNING | EVENTS;
  }
  pulse.high = RUNNING | EVENTS | frames;
}

// Writes `port` to port B in the very cycle in which timer 1 shows `at`. The timer is read in a loop of seven cycles;
// what is left after it, 9 to 15 cycles, is known, and bits 0 to 2 of it are burnt, one cycle for each `BURN`.
// Returns how many cycles too late it was.
#define READ_TO_WRITE 21  // From the reading of the timer to the writing of the port, nothing burnt.
#define BURN(bit) "sbrc %[rest], " #bit "\n rjmp .+0\n "
static inline uint16_t fire(uint16_t at, uint8_t port) {
  uint16_t left = at - TCNT1;
  if ((int16_t)left < LATEST) {
    PORTB = port;
    return TCNT1 - at;
  }
  while ((uint16_t)(at - TCNT1) > 200) {
  }
  uint8_t target = (uint8_t)at - READ_TO_WRITE + 8;
  uint8_t rest;
  __asm__ volatile(
      "1: lds %[rest], %[timer]\n "
      "neg %[rest]\n "
      "add %[rest], %[target]\n "
      "cpi %[rest], 16\n "
      "brsh 1b\n " BURN(0) BURN(1) BURN(1) BURN(2) BURN(2) BURN(2) BURN(2) "out %[portb], %[port]"
      : [rest] "=&d"(rest)
      : [timer] "i"(_SFR_MEM_ADDR(TCNT1L)), [target] "r"(target), [port] "r"(port), [portb] "I"(_SFR_IO_ADDR(PORTB)));
  return 0;
}

static void report(uint16_t late_by) {
  uint8_t next = (reports_in + 1) & (REPORTS - 1);
  if (next == reports_out) {
    lost++;
    return;
  }
  reports[reports_in] = (pulse_t){count, tick_plus(pulse.rise, late_by), pulse.exposure};
  reports_in = next;
}

// Plans the interrupt for the edge `offset` ticks after the rise. Returns false if there is no time for an interrupt.
static bool plan(uint32_t offset) {
  uint32_t edge = pulse.rise.low + offset;
  edge_at = edge;
  // The edge lies less than one period ahead, so that 32 bits of the clock tell how far.
  int32_t left = edge - clock_now().low;
  if (left < STAY) return false;
  // Were the match this near (but for whole turns of the timer), it might pass before it is set.
  uint16_t lead = LEAD;
  if ((uint16_t)(left - LEAD) < MATCH_MARGIN) lead += MATCH_MARGIN;
  OCR1A = edge_at - lead;
  wraps_left = (left - lead) >> 16;
  return true;
}

// Gives the next falling edge, and the one after it if that is near; returns how long after the rise the next is due.
static uint32_t fall(void) {
  if (next_edge == FALL) {
    late += fire(edge_at, pulse.middle) != 0;
    next_edge = LAST_FALL;
    if (pulse.last_fall - pulse.fall >= NEAR) return pulse.last_fall;
    edge_at += (uint16_t)(pulse.last_fall - pulse.fall);
  }
  late += fire(edge_at, stopping ? 0 : RUNNING) != 0;
  if (stopping) {
    TIMSK1 &= ~_BV(OCIE1A);
    next_edge = IDLE;
  } else {
    pulse.rise = tick_plus(pulse.rise, pulse.period);
    prepare();
    next_edge = RISE;
  }
  return 0;
}

// Gives the rising edge, and the falling edge after it if that is near; returns as `fall`.
static uint32_t rise(void) {
  uint16_t late_by = fire(edge_at, pulse.high);
  next_edge = pulse.fall == pulse.last_fall ? LAST_FALL : FALL;
  uint32_t offset = pulse.fall;
  if (offset < NEAR) {
    // So short is only an exposure, never the event cameras' pulse: the last fall is still to come.
    edge_at += (uint16_t)offset;
    offset = fall();
  }
  late += late_by != 0;
  report(late_by);
  count++;
  return offset;
}

ISR(TIMER1_COMPA_vect) {
  if (wraps_left) {
    wraps_left--;
    return;
  }
  uint32_t offset;
  do offset = next_edge == RISE ? rise() : fall();
  while (next_edge != IDLE && !plan(offset));
}

settings_t pulses_settings(void) { return settings; }

void pulses_configure(settings_t wanted) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { settings = wanted; }
}

bool pulses_running(void) { return next_edge != IDLE; }

tick_t pulses_start(void) {
  // No match of before may count as the first of this train: the next is put a turn of the timer away, and the flag of the
  // last is cleared. That is done with interrupts on: simavr takes an overflow that waits for its handler away with it,
  // and the clock would be a turn late from then on.
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { OCR1A = TCNT1 - 1; }
  TIFR1 = _BV(OCF1A);
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    stopping = false;
    count = 0;
    pulse.rise = tick_plus(clock_now(), START_AHEAD);
    prepare();
    next_edge = RISE;
    plan(0);
    TIMSK1 |= _BV(OCIE1A);
    PORTB = RUNNING;
  }
  return pulse.rise;
}

void pulses_stop(void) {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    stopping = true;
    if (next_edge == RISE) {
      TIMSK1 &= ~_BV(OCIE1A);
      next_edge = IDLE;
      PORTB = 0;
    }
  }
}

static uint32_t read(const volatile uint32_t *number) {
  uint32_t value;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { value = *number; }
  return value;
}

uint32_t pulses_count(void) { return read(&count); }
uint32_t pulses_late(void) { return read(&late); }
uint32_t pulses_lost(void) { return read(&lost); }

bool pulses_pending(void) { return reports_in != reports_out; }

bool pulses_take(pulse_t *taken) {
  uint8_t oldest = reports_out;
  if (!pulses_pending()) return false;
  *taken = reports[oldest];
  reports_out = (oldest + 1) & (REPORTS - 1);
  return true;
}
