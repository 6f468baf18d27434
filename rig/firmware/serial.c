#include "serial.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <stddef.h>
#include <util/crc16.h>

#define OUT 128  // A power of two.

static char out[OUT];
static volatile uint8_t out_in, out_out;

static char line[LINE_MAX];
static volatile uint8_t length;
static volatile bool complete, overlong;
static tick_t received_at;

static uint16_t checksum;

void serial_init(void) {
  UCSR0A = _BV(U2X0);
  UBRR0 = 3;  // 16 MHz / (8 (3 + 1)) = 500,000 baud, without error.
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

ISR(USART_RX_vect) {
  char byte = UDR0;
  // The host sends the next line after the answer to the last, so that nothing is lost here.
  if (complete || byte == '\r') return;
  if (byte == '\n') {
    if (length == 0) return;
    line[length] = 0;
    received_at = clock_now();
    complete = true;
  } else if (length < LINE_MAX - 1) {
    line[length++] = byte;
  } else {
    overlong = true;
  }
}

ISR(USART_UDRE_vect) {
  UDR0 = out[out_out];
  out_out = (out_out + 1) & (OUT - 1);
  if (out_out == out_in) UCSR0B &= ~_BV(UDRIE0);
}

const char *serial_line(tick_t *received, bool *too_long) {
  if (!complete) return NULL;
  *received = received_at;
  *too_long = overlong;
  return line;
}

void serial_next(void) {
  length = 0;
  overlong = false;
  complete = false;
}

bool serial_pending(void) { return complete; }

bool serial_room(uint8_t bytes) { return ((out_out - out_in - 1) & (OUT - 1)) >= bytes; }

static void put(char byte) {
  while (!serial_room(1)) {
  }
  out[out_in] = byte;
  out_in = (out_in + 1) & (OUT - 1);
  // The handler clears this bit in the same register, so that no interrupt may come between.
  cli();
  UCSR0B |= _BV(UDRIE0);
  sei();
}

static void put_digit(uint8_t digit) { put(digit < 10 ? '0' + digit : 'a' + digit - 10); }

static void say_byte(char byte) {
  checksum = _crc_xmodem_update(checksum, byte);
  put(byte);
}

void say(const char *text) {
  while (*text) say_byte(*text++);
}

static void say_digits(uint32_t number, bool all) {
  for (uint8_t i = 0; i < 8; i++, number <<= 4) {
    uint8_t digit = number >> 28;
    all |= digit != 0 || i == 7;
    if (all) say_byte(digit < 10 ? '0' + digit : 'a' + digit - 10);
  }
}

void say_hex(uint32_t number) {
  say_byte(' ');
  say_digits(number, false);
}

void say_tick(tick_t tick) {
  say_byte(' ');
  if (tick.high) say_digits(tick.high, false);
  say_digits(tick.low, tick.high != 0);
}

void say_end(void) {
  uint16_t sum = checksum;
  checksum = 0;
  put('*');
  for (uint8_t i = 0; i < 4; i++, sum <<= 4) put_digit(sum >> 12);
  put('\n');
}

void say_nothing(void) { put('\n'); }
