/* The fielded base's firmware in simavr: an ATmega2560 at 16 MHz that plays sequences of bytes on
 * its register bus. Each sequence runs in a child of the process that has started the chip, so that no
 * sequence leaves a trace in the next one.
 *
 *   usage: chip FIRMWARE.elf
 *
 * Standard input, a sequence a line:  BEGIN END (CYCLE BYTE)*
 * Standard output, a line for each:   (CYCLE BYTE)* [!]
 *
 * BEGIN never falls from line to line. A received byte's stop bit ends at CYCLE, a sent byte's start
 * bit begins there. An exclamation mark follows if the chip crashed.
 *
 * Cycles count from the start of the chip, bytes are decimal. simavr's own receiver has 64 places and
 * a character of eleven bits; here it has the data sheet's two places and a shift register, and ten
 * bits. The transmitter is simavr's own: it asks for the next byte when the one before has left, where
 * the data sheet has a register in front of the line.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <avr_adc.h>
#include <avr_extint.h>
#include <avr_ioport.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>
#include <sim_io.h>

enum { BYTES_MAX = 1024, SENT_MAX = 4096, PLACES = 3, CYCLES_PER_BYTE = 160 };

/* What the converter's channels read: nothing in sight, a floor, a battery of 12.4 V. */
static const unsigned READINGS[16] = {[7] = 500, [9] = 846};

/* The converter's source of each multiplexer setting. simavr 1.6 has values for eight inputs only. */
static uint8_t source_of[64];

static avr_t *avr;
static avr_uart_t *uart;
static uint8_t waiting[PLACES];
static size_t waiting_len;
static avr_cycle_count_t free_at;
static struct {
    avr_cycle_count_t cycle;
    uint8_t byte;
} sent[SENT_MAX];
static size_t sent_len;

static void hand_over(void) {
    if (waiting_len == 0 || uart->input.read != uart->input.write)
        return;
    uint8_t byte = waiting[0];
    memmove(waiting, waiting + 1, --waiting_len);
    uart->cycles_per_byte = 2;
    avr_raise_irq(uart->io.irq + UART_IRQ_INPUT, byte);
    uart->cycles_per_byte = CYCLES_PER_BYTE;
}

static void on_room(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    (void)param;
    hand_over();
}

static void receive(uint8_t byte) {
    size_t places = PLACES - (uart->input.read != uart->input.write);
    if (waiting_len == places)
        waiting[waiting_len - 1] = byte;
    else
        waiting[waiting_len++] = byte;
    hand_over();
}

static void on_sent(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)param;
    uart->cycles_per_byte = CYCLES_PER_BYTE;
    avr_cycle_count_t start = free_at > avr->cycle ? free_at : avr->cycle;
    free_at = start + CYCLES_PER_BYTE;
    if (sent_len < SENT_MAX) {
        sent[sent_len].cycle = start;
        sent[sent_len++].byte = (uint8_t)value;
    }
}

static int is_alive(void) { return avr->state != cpu_Crashed && avr->state != cpu_Done; }

static void run_to(avr_cycle_count_t cycle) {
    while (avr->cycle < cycle && is_alive())
        avr_run(avr);
}

static void quiet(avr_t *chip, const int level, const char *format, va_list arguments) {
    (void)chip;
    (void)level;
    (void)format;
    (void)arguments;
}

/* The chip wakes at once: its time is that of the cycles. */
static void no_sleep(avr_t *chip, avr_cycle_count_t how_long) {
    (void)chip;
    (void)how_long;
}

/* A conversion begins: its reading is 1023 times the voltage's share of the reference, rounded down;
 * half a step more is safe. */
static void on_conversion(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    avr_adc_t *adc = param;
    uint8_t setting = avr_regbit_get_array(avr, adc->mux, ARRAY_SIZE(adc->mux));
    if (setting < 64 && adc->muxmode[setting].kind == ADC_MUX_SINGLE)
        adc->adc_values[source_of[setting] & 7] =
            (uint16_t)((READINGS[source_of[setting] & 15] * 2 + 1) * 5000 / 2046);
}

static void feed(avr_adc_t *adc) {
    for (size_t setting = 0; setting < 64; setting++) {
        source_of[setting] = (uint8_t)adc->muxmode[setting].src;
        if (adc->muxmode[setting].kind == ADC_MUX_SINGLE)
            adc->muxmode[setting].src &= 7;
    }
    avr_irq_register_notify(adc->io.irq + ADC_IRQ_OUT_TRIGGER, on_conversion, adc);
}

static void start(const char *path) {
    static elf_firmware_t firmware;
    avr_global_logger_set(quiet);
    if (elf_read_firmware(path, &firmware) != 0) {
        fprintf(stderr, "chip: %s is no ELF file\n", path);
        exit(2);
    }
    avr = avr_make_mcu_by_name("atmega2560");
    avr_init(avr);
    avr->frequency = 16000000;
    avr->sleep = no_sleep;
    avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = avr->aref = 5000;
    for (avr_io_t *io = avr->io_port; io; io = io->next) {
        uint32_t no_flags = 0;
        if (strcmp(io->kind, "uart") == 0) {
            char name = ((avr_uart_t *)io)->name;
            avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS(name), &no_flags);
            if (name == '1')
                uart = (avr_uart_t *)io;
        } else if (strcmp(io->kind, "adc") == 0) {
            feed((avr_adc_t *)io);
        }
    }
    /* The firmware enables no external interrupt: simavr need not look at low pins in each cycle. */
    for (uint8_t n = 0; n < EXTINT_COUNT; n++)
        avr_extint_set_strict_lvl_trig(avr, n, 0);
    /* The stop button is released: it pulls pin C3 down, against the pull-up of the chip. */
    avr_ioport_external_t released = {.name = 'C', .mask = 1 << 3, .value = 0};
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('C'), &released);
    avr_irq_register_notify(uart->io.irq + UART_IRQ_OUTPUT, on_sent, NULL);
    avr_irq_register_notify(uart->io.irq + UART_IRQ_OUT_XON, on_room, NULL);
}

/* Plays the rest of a line; prints what the chip sent. */
static void play(char *at) {
    avr_cycle_count_t end = strtoull(at, &at, 10);
    sent_len = 0;
    for (;;) {
        char *behind;
        avr_cycle_count_t cycle = strtoull(at, &behind, 10);
        if (behind == at)
            break;
        uint8_t byte = (uint8_t)strtoul(behind, &at, 10);
        run_to(cycle);
        if (is_alive())
            receive(byte);
    }
    run_to(end);
    for (size_t i = 0; i < sent_len; i++)
        printf("%llu %u ", (unsigned long long)sent[i].cycle, sent[i].byte);
    puts(is_alive() ? "" : "!");
    fflush(stdout);
}

int main(int argc, char **argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: chip FIRMWARE.elf\n");
        return 2;
    }
    start(argv[1]);
    static char line[BYTES_MAX * 16];
    while (fgets(line, sizeof line, stdin)) {
        char *rest;
        run_to(strtoull(line, &rest, 10));
        pid_t child = fork();
        if (child == 0) {
            play(rest);
            _exit(0);
        }
        int status;
        if (child < 0 || waitpid(child, &status, 0) != child || status != 0) {
            fprintf(stderr, "chip: a sequence could not be played\n");
            return 1;
        }
    }
    return 0;
}
