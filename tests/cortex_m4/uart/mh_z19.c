/* Unmodified UART firmware: asks an MH-Z19 on the first UART for the concentration of CO2 and
 * reports it on the second. For QEMU's mps2-an386 (CMSDK UARTs) and, with STM32, netduinoplus2.
 * With MUTE it reads only. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define REG(at) (*(volatile uint32_t *)(at))

extern uint32_t stack_top;
void reset(void);

__attribute__((section(".vectors"), used)) static const void *vectors[16] = {&stack_top, reset};

#ifdef STM32
static const uint32_t uarts[2] = {0x40011000, 0x40004400}; /* USART1, USART2 */
#define CLOCK_HZ 168000000

static void uart_begin(int n) {
    REG(uarts[n] + 0x08) = 16000000 / 9600;              /* BRR */
    REG(uarts[n] + 0x0C) = 1 << 13 | 1 << 3 | 1 << 2;    /* CR1: enabled, both ways */
}
static bool can_write(int n) { return REG(uarts[n]) & 1 << 7; }
static bool can_read(int n) { return REG(uarts[n]) & 1 << 5; }
static volatile uint32_t *data(int n) { return &REG(uarts[n] + 4); }
#else
static const uint32_t uarts[2] = {0x40004000, 0x40005000}; /* UART0, UART1 */
#define CLOCK_HZ 25000000

static void uart_begin(int n) {
    REG(uarts[n] + 0x10) = CLOCK_HZ / 9600; /* BAUDDIV */
    REG(uarts[n] + 0x08) = 3;               /* CTRL: both ways */
}
static bool can_write(int n) { return !(REG(uarts[n] + 4) & 1); }
static bool can_read(int n) { return REG(uarts[n] + 4) & 2; }
static volatile uint32_t *data(int n) { return &REG(uarts[n]); }
#endif

/* The system timer counts down its 24 bits; it is read at least once in each of its turns. */
static uint32_t now_ms(void) {
    static uint32_t before, rest, now;
    uint32_t count = REG(0xE000E018);
    rest += (before - count) & 0xFFFFFF;
    before = count;
    now += rest / (CLOCK_HZ / 1000);
    rest %= CLOCK_HZ / 1000;
    return now;
}

static void put(int n, uint8_t byte) {
#ifdef MUTE
    return;
#endif
    while (!can_write(n))
        now_ms();
    *data(n) = byte;
}

static void say(const char *text) {
    while (*text)
        put(1, (uint8_t)*text++);
}

static uint8_t check(const uint8_t *frame) {
    uint8_t sum = 0;
    for (int i = 1; i < 8; i++)
        sum += frame[i];
    return (uint8_t)(0xFF - sum + 1);
}

static void report(uint32_t ppm) {
    char digits[6] = "00000";
    for (int i = 4; i >= 0; i--, ppm /= 10)
        digits[i] = (char)('0' + ppm % 10);
    say("ppm ");
    say(digits);
    say("\r\n");
}

static void ask(void) {
    while (can_read(0))
        (void)*data(0);
    uint8_t frame[9] = {0xFF, 0x01, 0x86, 0, 0, 0, 0, 0, 0x79};
    for (int i = 0; i < 9; i++)
        put(0, frame[i]);
    int len = 0;
    for (uint32_t start = now_ms(); len < 9 && now_ms() - start < 500;)
        if (can_read(0))
            frame[len++] = (uint8_t)*data(0);
    if (len == 9 && frame[1] == 0x86 && frame[8] == check(frame))
        report((uint32_t)(frame[2] << 8 | frame[3]));
    else
        say("no answer\r\n");
}

void reset(void) {
    REG(0xE000E014) = 0xFFFFFF;            /* SYST_RVR */
    REG(0xE000E018) = 0;                   /* SYST_CVR */
    REG(0xE000E010) = 5;                   /* SYST_CSR: on, the processor's clock */
    uart_begin(0);
    uart_begin(1);
    for (;;) {
        ask();
        for (uint32_t start = now_ms(); now_ms() - start < 1000;) {
        }
    }
}
