/* firmware.c - main program of a board: FMUs, the board's end of the protocol, and a driver.
 *
 * The driver of an emulated processor reads and writes two pipes of the host by semihosting. The
 * arguments of main() name the pipes. On hardware use a driver of your own instead:
 * docs/protocol.md. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "board.h"

#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

/* defined in components.c, which is generated for each firmware */
extern const Software software[];
extern Slot slot[];
extern const size_t software_count;
extern const char target_name[];

typedef struct { int in, out; } Pipes;

static size_t read_pipe(void *port, void *bytes, size_t most)
{
    ssize_t got = read(((Pipes *)port)->in, bytes, most);
    return got > 0 ? (size_t)got : 0;
}

static bool write_pipe(void *port, const void *bytes, size_t count)
{
    const char *from = bytes;
    while (count > 0) {
        ssize_t done = write(((Pipes *)port)->out, from, count);
        if (done <= 0) return false;
        from += done;
        count -= (size_t)done;
    }
    return true;
}

/* ---- instruction counter; in the emulator all instructions take the same time, so that a timer
 * counts them too */
#if defined __riscv
static uint64_t read_counter(
    void) /* instret, read as two halves on rv32 until no carry occurs between the readings */
{
#if __riscv_xlen == 64
    uint64_t count;
    __asm__ volatile("rdinstret %0" : "=r"(count));
    return count;
#else
    uint32_t high, low, again;
    do
        __asm__ volatile("rdinstreth %0\n rdinstret %1\n rdinstreth %2"
                         : "=r"(high), "=r"(low), "=r"(again));
    while (high != again);
    return (uint64_t)high << 32 | low;
#endif
}
static void start_counter(void) {}
#else
/* timer 0 of the MPS2 boards counts down at 25 MHz; with the option -icount shift=6 of QEMU an
 * instruction takes 64 ns */
typedef struct { volatile uint32_t control, value, reload; } Timer;
static Timer *const timer = (Timer *)0x40000000;

static void start_counter(void)
{
    timer->reload = timer->value = UINT32_MAX;
    timer->control = 1;
}
static uint64_t read_counter(void) /* timer ticks of 40 ns, converted to instructions */
{
    static uint64_t ticks;
    static uint32_t last = UINT32_MAX;
    uint32_t now = timer->value;
    ticks += last - now;
    last = now;
    return ticks * 5 / 8;
}
#endif

/* ---- stack: paint_stack() fills it with a pattern; measure_stack() returns the number of bytes
 * from the upper end to the lowest byte that no longer has the pattern */
extern unsigned char __stack[]; /* upper end of the stack, from picolibc's linker script */
enum { PATTERN = 0xa5, MARGIN = 256, STACK_SIZE = 0x40000 };

static void paint_stack(void)
{
    volatile unsigned char here;
    volatile unsigned char *top = &here - MARGIN;
    for (volatile unsigned char *at = __stack - STACK_SIZE; at < top; at++) *at = PATTERN;
}

static uint32_t measure_stack(void)
{
    const unsigned char *at = __stack - STACK_SIZE;
    while (at < __stack && *at == PATTERN) at++;
    return (uint32_t)(__stack - at);
}

int main(int count, char *argument[])
{
    if (count < 3) return 2;
    Pipes pipes = {open(argument[1], O_RDONLY), open(argument[2], O_WRONLY)};
    if (pipes.in < 0 || pipes.out < 0) return 2;
    start_counter();
    serve(&(Board){target_name, software, slot, software_count, read_pipe, write_pipe, &pipes,
                   read_counter, paint_stack, measure_stack});
    return 0;
}
