/* An ATmega2560 of simavr whose surroundings are the parent process: each transaction on its
 * two-wire bus, its pins 6 and 7 and its serial output are lines on standard input and output.
 *
 *   S T ADDRESS   start of a transaction at T us, read in the lowest bit  ->  1 acknowledged, or 0
 *   W BYTE        the master writes                                      ->  1
 *   R             the master reads                                       ->  the byte
 *   E             stop
 *   P T           pins at T us                                           ->  A + 2 B
 *   U T BYTE      a byte of the serial port at T us
 *
 * All numbers are decimal. usage: harness FIRMWARE.elf MILLISECONDS
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <avr_ioport.h>
#include <avr_twi.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_elf.h>

static const uint32_t FREQUENCY = 16000000;
/* Between two looks at the pins. */
static const uint32_t PIN_PERIOD_US = 250;

static avr_t *avr;
static avr_irq_t *pins[2];
static avr_irq_t *bus;
static uint8_t selected;

static unsigned long long now_us(void) { return avr->cycle / (FREQUENCY / 1000000); }

/* What the parent answers to what was just said. */
static unsigned answer(void) {
    unsigned value;
    fflush(stdout);
    if (scanf("%u", &value) != 1)
        exit(1);
    return value;
}

static void on_bus(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)param;
    avr_twi_msg_irq_t message;
    message.u.v = value;
    uint8_t what = message.u.twi.msg;
    if (what & TWI_COND_STOP) {
        if (selected)
            puts("E");
        selected = 0;
    }
    if (what & TWI_COND_START) {
        printf("S %llu %u\n", now_us(), message.u.twi.addr);
        selected = answer() ? message.u.twi.addr : 0;
        if (selected)
            avr_raise_irq(bus + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, selected, 1));
    }
    if (selected && (what & TWI_COND_WRITE)) {
        printf("W %u\n", message.u.twi.data);
        answer();
        avr_raise_irq(bus + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_ACK, selected, 1));
    }
    if (selected && (what & TWI_COND_READ)) {
        puts("R");
        avr_raise_irq(bus + TWI_IRQ_INPUT, avr_twi_irq_msg(TWI_COND_READ, selected, answer()));
    }
}

static void on_serial(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)param;
    printf("U %llu %u\n", now_us(), value & 0xFF);
}

static avr_cycle_count_t look_at_pins(struct avr_t *chip, avr_cycle_count_t when, void *param) {
    (void)chip;
    (void)param;
    printf("P %llu\n", now_us());
    unsigned state = answer();
    avr_raise_irq(pins[0], state & 1);
    avr_raise_irq(pins[1], state >> 1 & 1);
    return when + PIN_PERIOD_US * (FREQUENCY / 1000000);
}

int main(int argc, char **argv) {
    static elf_firmware_t firmware;
    if (argc != 3 || elf_read_firmware(argv[1], &firmware) != 0) {
        fprintf(stderr, "usage: harness FIRMWARE.elf MILLISECONDS\n");
        return 2;
    }
    avr = avr_make_mcu_by_name("atmega2560");
    if (!avr)
        return 2;
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->frequency = FREQUENCY;
    avr->log = LOG_ERROR;

    static const char *names[] = {"8<bus.in", "32>bus.out"};
    bus = avr_alloc_irq(&avr->irq_pool, 0, 2, names);
    avr_irq_register_notify(bus + TWI_IRQ_OUTPUT, on_bus, NULL);
    avr_connect_irq(bus + TWI_IRQ_INPUT,
                    avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_INPUT));
    avr_connect_irq(avr_io_getirq(avr, AVR_IOCTL_TWI_GETIRQ(0), TWI_IRQ_OUTPUT),
                    bus + TWI_IRQ_OUTPUT);

    /* Nothing of the chip's is printed but by us. */
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
                            on_serial, NULL);
    /* Pins 6 and 7 of the board. */
    pins[0] = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('H'), 3);
    pins[1] = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('H'), 4);
    avr_cycle_timer_register_usec(avr, PIN_PERIOD_US, look_at_pins, NULL);

    avr_cycle_count_t end = (avr_cycle_count_t)atol(argv[2]) * (FREQUENCY / 1000);
    while (avr->cycle < end) {
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed)
            return 1;
    }
    return 0;
}
