// The trigger board in simavr: an AVR program runs with USART 0 on a terminal, and every change of its ports is logged
// with the processor's cycle.
//
// usage: board FIRMWARE.elf TERMINAL LOG [LINES]
//
// TERMINAL is a terminal device that USART 0 is connected to; if there is none of this name, it becomes a symbolic link
// to a new pseudo-terminal. LOG gets a line for each change of port B or C: "cycle B|C value" (hexadecimal value); and
// "cycle L milliseconds" whenever the simulation is further behind the wall clock than ever before (and by 50 ms or
// more). LINES gets each edge of the event cameras' output (D8) as erfgs-usbd takes it on its standard input: "trigger
// NS 0|1", a time of CLOCK_MONOTONIC. "ready" on the standard output says that the terminal is there. Runs at the pace
// of the wall clock. SIGUSR1 is the reset button. Ends when its standard input does, so that it never outlives its
// parent.
#define _GNU_SOURCE
#include <errno.h>
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
#include <sys/stat.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define HZ 16000000
#define SLICE (HZ / 2000)  // Cycles between looks at the terminal: half a millisecond.

static avr_t *avr;
static int terminal;
static int room = 1;
static FILE *edges, *lines;
static avr_cycle_count_t cycles_before_reset;
static double began;
static volatile sig_atomic_t button;

static void on_button(int signal) {
  (void)signal;
  button = 1;
}

static unsigned long long cycle_now(void) { return cycles_before_reset + avr->cycle; }

static void on_port(avr_irq_t *irq, uint32_t value, void *name) {
  (void)irq;
  static uint32_t last[2];
  int which = *(const char *)name == 'C';
  uint32_t changed = value ^ last[which];
  if (!changed) return;
  last[which] = value;
  fprintf(edges, "%llu %s %x\n", cycle_now(), (const char *)name, value);
  if (lines && which == 0 && changed & 1) {
    fprintf(lines, "trigger %lld %u\n", (long long)(began * 1e9) + (long long)(cycle_now() * 125 / 2), value & 1);
  }
}

static void on_output(avr_irq_t *irq, uint32_t value, void *unused) {
  (void)irq, (void)unused;
  char byte = value;
  // A full terminal is one that nobody has read for long, or whose reader gets no processor time. The latter is none of
  // the board's business, so that it waits; when nobody reads, a serial line loses the byte as well.
  static int nobody;
  struct pollfd room_for_it = {.fd = terminal, .events = POLLOUT};
  while (write(terminal, &byte, 1) < 0 && (errno == EAGAIN || errno == EINTR)) {
    if (nobody) return;
    nobody = poll(&room_for_it, 1, 3000) == 0;
  }
  nobody = 0;
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

// Opens the terminal of this name, or makes one. Returns 0 if it cannot.
static int open_terminal(const char *name) {
  struct stat is;
  struct termios settings;
  char slave_name[64];
  int slave;
  if (!stat(name, &is) && S_ISCHR(is.st_mode)) {
    slave = terminal = open(name, O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (terminal < 0) return perror(name), 0;
  } else {
    if (openpty(&terminal, &slave, slave_name, NULL, NULL)) return perror("board: openpty"), 0;
    unlink(name);
    if (symlink(slave_name, name)) return perror("board: symlink"), 0;
  }
  tcgetattr(slave, &settings);
  cfmakeraw(&settings);
  tcsetattr(slave, TCSANOW, &settings);
  fcntl(terminal, F_SETFL, O_NONBLOCK);
  return 1;
}

int main(int count, char **arguments) {
  if (count != 4 && count != 5) return fprintf(stderr, "usage: board FIRMWARE.elf TERMINAL LOG [LINES]\n"), 2;

  elf_firmware_t firmware = {0};
  if (elf_read_firmware(arguments[1], &firmware)) return fprintf(stderr, "board: cannot read %s\n", arguments[1]), 1;
  avr = avr_make_mcu_by_name("atmega328p");
  if (!avr) return fprintf(stderr, "board: this simavr does not know the ATmega328P\n"), 1;
  avr_init(avr);
  avr_load_firmware(avr, &firmware);
  avr->frequency = HZ;
  avr->sleep = no_sleep;

  if (!open_terminal(arguments[2])) return 1;
  edges = fopen(arguments[3], "w");
  if (!edges) return perror("board: log"), 1;
  setvbuf(edges, NULL, _IOLBF, 0);
  if (count == 5) {
    lines = fopen(arguments[4], "w");
    if (!lines) return perror("board: lines"), 1;
    setvbuf(lines, NULL, _IOLBF, 0);
  }
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
  began = seconds();
  double worst_lag = 0.05;
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

    double ahead = (double)cycle_now() / HZ - (seconds() - began);
    if (-ahead > worst_lag) {
      worst_lag = -ahead;
      fprintf(edges, "%llu L %.0f\n", cycle_now(), worst_lag * 1e3);
    }
    struct pollfd parent = {.fd = 0, .events = POLLIN};
    if (poll(&parent, 1, ahead > 0 ? (int)(ahead * 1e3) : 0) > 0) {
      char ignored[64];
      if (read(0, ignored, sizeof ignored) <= 0) return 0;
    }
  }
}
