// The trigger board in simavr: an AVR program runs with USART 0 on a pseudo-terminal, and every change of its ports is
// logged with the processor's cycle.
//
// usage: board FIRMWARE.elf LINK LOG
//
// LINK becomes a symbolic link to the pseudo-terminal. LOG gets a line for each change of port B or C: "cycle B|C
// value" (hexadecimal value). "ready" on the standard output says that the link is there. Runs at the pace of the wall
// clock. SIGUSR1 is the reset button. Ends when its standard input does, so that it never outlives its parent.
#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define HZ 16000000
#define SLICE (HZ / 2000)  // Cycles between looks at the terminal: half a millisecond.

static avr_t *avr;
static int terminal;
static int room = 1;
static FILE *edges;
static avr_cycle_count_t cycles_before_reset;
static volatile sig_atomic_t button;

static void on_button(int signal) {
  (void)signal;
  button = 1;
}

static void on_port(avr_irq_t *irq, uint32_t value, void *name) {
  (void)irq;
  static uint32_t last[2];
  int which = *(const char *)name == 'C';
  if (value == last[which]) return;
  last[which] = value;
  fprintf(edges, "%llu %s %x\n", (unsigned long long)(cycles_before_reset + avr->cycle), (const char *)name, value);
}

static void on_output(avr_irq_t *irq, uint32_t value, void *unused) {
  (void)irq, (void)unused;
  char byte = value;
  // Nobody reads, and the terminal is full: a serial line loses the byte as well.
  if (write(terminal, &byte, 1) < 0) return;
}

static void on_xon(avr_irq_t *irq, uint32_t value, void *unused) {
  (void)irq, (void)value, (void)unused;
  room = 1;
}

static void on_xoff(avr_irq_t *irq, uint32_t value, void *unused) {
  (void)irq, (void)value, (void)unused;
  room = 0;
}

static void no_sleep(avr_t *a, avr_cycle_count_t cycles) { (void)a, (void)cycles; }

static double seconds(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec + t.tv_nsec * 1e-9;
}

int main(int count, char **arguments) {
  if (count != 4) return fprintf(stderr, "usage: board FIRMWARE.elf LINK LOG\n"), 2;

  elf_firmware_t firmware = {0};
  if (elf_read_firmware(arguments[1], &firmware)) return fprintf(stderr, "board: cannot read %s\n", arguments[1]), 1;
  avr = avr_make_mcu_by_name("atmega328p");
  if (!avr) return fprintf(stderr, "board: this simavr does not know the ATmega328P\n"), 1;
  avr_init(avr);
  avr_load_firmware(avr, &firmware);
  avr->frequency = HZ;
  avr->sleep = no_sleep;

  int slave;
  char name[64];
  struct termios settings;
  if (openpty(&terminal, &slave, name, NULL, NULL)) return perror("board: openpty"), 1;
  tcgetattr(slave, &settings);
  cfmakeraw(&settings);
  tcsetattr(slave, TCSANOW, &settings);
  fcntl(terminal, F_SETFL, O_NONBLOCK);
  unlink(arguments[2]);
  if (symlink(name, arguments[2])) return perror("board: symlink"), 1;
  edges = fopen(arguments[3], "w");
  if (!edges) return perror("board: log"), 1;
  setvbuf(edges, NULL, _IOLBF, 0);
  struct sigaction action = {.sa_handler = on_button};
  sigaction(SIGUSR1, &action, NULL);
  signal(SIGPIPE, SIG_IGN);  // simavr may have more to say when nobody listens any more.

  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
  flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_output, NULL);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_xon, NULL);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_xoff, NULL);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_REG_PORT), on_port, "B");
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), IOPORT_IRQ_REG_PORT), on_port, "C");

  printf("ready\n");
  fflush(stdout);
  double began = seconds();
  avr_cycle_count_t until = SLICE;
  for (;;) {
    while (avr->cycle < until) {
      int state = avr_run(avr);
      if (state == cpu_Done || state == cpu_Crashed) return fprintf(stderr, "board: processor state %d\n", state), 3;
    }
    if (button) {
      button = 0;
      cycles_before_reset += avr->cycle;
      avr_reset(avr);
      avr->cycle = 0;
      room = 1;
      until = 0;
    }
    until += SLICE;
    char byte;
    for (int i = 0; room && i < 32 && read(terminal, &byte, 1) == 1; i++) avr_raise_irq(input, (uint8_t)byte);

    double ahead = (double)(cycles_before_reset + avr->cycle) / HZ - (seconds() - began);
    struct pollfd parent = {.fd = 0, .events = POLLIN};
    if (poll(&parent, 1, ahead > 0 ? (int)(ahead * 1e3) : 0) > 0) {
      char ignored[64];
      if (read(0, ignored, sizeof ignored) <= 0) return 0;
    }
  }
}
