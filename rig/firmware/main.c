// Trigger board for synchronised cameras: ATmega328P at 16 MHz (Arduino Uno or Nano). See PROTOCOL.md and
// docs/reference/trigger-board.md.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <util/atomic.h>
#include <util/crc16.h>

#include "clock.h"
#include "leds.h"
#include "pulses.h"
#include "serial.h"

#define NAME " erfgs-trigger"
#define PROTOCOL 1
#define FIRMWARE 1

#define PULSE_LINE_MAX 40
#define ARGUMENTS 3

enum error { OK, DAMAGED, UNKNOWN, ARGUMENT, RANGE, BUSY, TOO_LONG };

static uint32_t bad_lines;
static bool answer_stop;

static tick_t now(void) {
  tick_t tick;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { tick = clock_now(); }
  return tick;
}

static void say_identity(void) {
  say(NAME);
  say_hex(PROTOCOL);
  say_hex(FIRMWARE);
  say_hex(F_CPU);
  say_hex(FRAME_OUTPUTS);
}

static void refuse(const char *command, enum error error) {
  say("-");
  say(command);
  say_hex(error);
  say_end();
}

// Reads one hexadecimal digit; 16 if it is none.
static uint8_t digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return 16;
}

static bool number(const char *text, uint32_t *value) {
  uint8_t length = strlen(text);
  if (length == 0 || length > 8) return false;
  *value = 0;
  for (; *text; text++) {
    uint8_t d = digit(*text);
    if (d > 15) return false;
    *value = *value << 4 | d;
  }
  return true;
}

// Cuts the checksum off the line. False if there is none or it is wrong.
static bool verify(char *line) {
  uint8_t length = strlen(line);
  if (length < 6 || line[length - 5] != '*') return false;
  uint32_t told;
  if (!number(line + length - 4, &told)) return false;
  uint16_t sum = 0;
  line[length - 5] = 0;
  for (const char *c = line; *c; c++) sum = _crc_xmodem_update(sum, *c);
  return sum == told;
}

// Cuts the line at its spaces; returns how many arguments follow the command, at most one more than there may be.
static uint8_t split(char *line, char *arguments[ARGUMENTS]) {
  uint8_t count = 0;
  while ((line = strchr(line, ' '))) {
    *line++ = 0;
    if (count == ARGUMENTS) return ARGUMENTS + 1;
    arguments[count++] = line;
  }
  return count;
}

static enum error set_pulse(char which, uint32_t value) {
  settings_t settings = pulses_settings();
  if (which == 'p') {
    if (value < PERIOD_MIN || value > PERIOD_MAX) return RANGE;
    settings.period = value;
  } else if (which == 'e') {
    if (value < EXPOSURE_MIN || value > PERIOD_MAX) return RANGE;
    settings.exposure = value;
  } else {
    if (value >= _BV(FRAME_OUTPUTS)) return RANGE;
    settings.outputs = value;
  }
  if (settings.exposure + EXPOSURE_GUARD > settings.period) return RANGE;
  pulses_configure(settings);
  return OK;
}

static void say_status(void) {
  settings_t settings = pulses_settings();
  say_hex(pulses_running());
  say_hex(settings.period);
  say_hex(settings.exposure);
  say_hex(settings.outputs);
  say_hex(pulses_count());
  say_tick(now());
  say_hex(pulses_lost());
  say_hex(pulses_late());
  say_hex(bad_lines);
}

static void done(const char *command) {
  say("+");
  say(command);
}

// Carries a command out and answers it, but for an error, which it returns.
static enum error obey(const char *command, char *const arguments[], uint8_t count, tick_t received) {
  bool is_clock = !strcmp(command, "clock");
  static const struct {
    char name[9];
    uint8_t arguments;
  } commands[] = {{"identify", 0}, {"period", 1}, {"exposure", 1}, {"outputs", 1}, {"start", 0},
                  {"stop", 0},     {"count", 0},  {"leds", 3},     {"clock", 1},   {"status", 0}};
  uint8_t which = 0;
  while (strcmp(command, commands[which].name)) {
    if (++which == sizeof commands / sizeof commands[0]) return UNKNOWN;
  }
  if (count != commands[which].arguments) return ARGUMENT;
  uint32_t values[ARGUMENTS];
  for (uint8_t i = 0; i < count && !is_clock; i++) {
    if (!number(arguments[i], &values[i])) return ARGUMENT;
  }

  switch (which) {
    case 0:
      done(command);
      say_identity();
      break;
    case 1:
    case 2:
    case 3: {
      enum error error = set_pulse(command[0], values[0]);
      if (error) return error;
      done(command);
      say_hex(values[0]);
      break;
    }
    case 4:
      if (pulses_running()) return BUSY;
      done(command);
      say_tick(pulses_start());
      break;
    case 5:
      pulses_stop();
      answer_stop = true;  // When the pulse under way is complete.
      return OK;
    case 6:
      done(command);
      say_hex(pulses_count());
      break;
    case 7: {
      uint16_t half_periods[LEDS];
      for (uint8_t i = 0; i < LEDS; i++) {
        if (values[i] > 0xffff) return RANGE;
        half_periods[i] = values[i];
      }
      leds_set(half_periods);
      done(command);
      for (uint8_t i = 0; i < LEDS; i++) say_hex(values[i]);
      break;
    }
    case 8: {
      uint8_t digits = 0;
      while (digit(arguments[0][digits]) < 16) digits++;
      if (digits == 0 || digits > 16 || arguments[0][digits]) return ARGUMENT;
      done(command);
      say(" ");
      say(arguments[0]);
      say_tick(received);
      break;
    }
    default:
      done(command);
      say_status();
  }
  say_end();
  return OK;
}

static void answer(char *line, tick_t received, bool too_long) {
  if (too_long || !verify(line)) {
    bad_lines++;
    refuse("?", too_long ? TOO_LONG : DAMAGED);
    return;
  }
  char *arguments[ARGUMENTS];
  uint8_t count = split(line, arguments);
  enum error error = obey(line, arguments, count, received);
  if (error) refuse(error == UNKNOWN ? "?" : line, error);
}

static void report_pulses(void) {
  pulse_t pulse;
  while (serial_room(PULSE_LINE_MAX) && pulses_take(&pulse)) {
    say("p");
    say_hex(pulse.index);
    say_tick(pulse.tick);
    say_hex(pulse.width);
    say_end();
  }
}

int main(void) {
  uint8_t cause = MCUSR;
  MCUSR = 0;
  clock_init();
  pulses_init();
  leds_init();
  serial_init();
  set_sleep_mode(SLEEP_MODE_IDLE);
  sei();

  say_nothing();
  say("b");
  say_identity();
  say_hex(cause);
  say_end();

  for (;;) {
    report_pulses();
    if (answer_stop && !pulses_running()) {
      answer_stop = false;
      report_pulses();
      done("stop");
      say_hex(pulses_count());
      say_end();
    }
    tick_t received;
    bool too_long;
    const char *line = serial_line(&received, &too_long);
    if (line && !answer_stop) {
      answer((char *)line, received, too_long);
      serial_next();
    }
    // Rests until an interrupt, unless one has come since: with interrupts off, nothing comes between look and sleep.
    cli();
    bool idle = !serial_pending() && !pulses_pending() && (!answer_stop || pulses_running());
    if (idle) {
      sleep_enable();
      sei();
      sleep_cpu();
      sleep_disable();
    }
    sei();
  }
}
