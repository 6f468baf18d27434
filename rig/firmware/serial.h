// Lines over USART 0, each with its checksum.
#pragma once

#include <stdbool.h>
#include <stdint.h>

#include "clock.h"

#define LINE_MAX 96

void serial_init(void);

// A line that came, without its ending; NULL if none did. It stays until `serial_next`.
const char *serial_line(tick_t *received, bool *too_long);
void serial_next(void);
bool serial_pending(void);

// A line to the host: its parts, then `say_end`. Waits while the buffer is full.
void say(const char *text);
void say_hex(uint32_t number);
void say_tick(tick_t tick);
void say_end(void);
// An empty line: ends half a line that a reset has cut.
void say_nothing(void);

// Whether a line of so many bytes can be said without waiting.
bool serial_room(uint8_t bytes);
