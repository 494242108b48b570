/* UARTs with the times and buffers of the data sheet. simavr's own receiver has 64 places and takes
 * a character one character's time late; its transmitter has no buffer and counts a parity bit
 * always. Here: two characters and a shift register each way, and bits as the registers say. */
#include <stdio.h>
#include <string.h>

#include "node.h"

/* Line events, as the rig counts them. */
enum line_event { OPENED, CLOSED, BREAK, FRAMING_ERROR, PARITY_ERROR, OVERRUN, CODING = 16 };

static uint32_t baud_of(const struct uart *uart) {
    avr_t *avr = chip.avr;
    const avr_uart_t *io = uart->io;
    uint32_t divisor = avr_regbit_get(avr, io->ubrrl) | (uint32_t)avr_regbit_get(avr, io->ubrrh) << 8;
    return avr->frequency / ((avr_regbit_get(avr, io->u2x) ? 8 : 16) * (divisor + 1));
}

/* Data bits, parity (0 none, 1 even, 2 odd), stop bits. */
static void coding_of(const struct uart *uart, uint8_t coding[3]) {
    avr_t *avr = chip.avr;
    const avr_uart_t *io = uart->io;
    uint8_t size = (uint8_t)(avr_regbit_get(avr, io->ucsz) | avr_regbit_get(avr, io->ucsz2) << 2);
    uint8_t parity = avr->data[io->usbs.reg] >> 4 & 3;
    coding[0] = size < 4 ? (uint8_t)(5 + size) : 8;
    coding[1] = parity == 2 ? 1 : parity == 3 ? 2 : 0;
    coding[2] = (uint8_t)(1 + avr_regbit_get(avr, io->usbs));
}

static avr_cycle_count_t cycles_per_byte(const struct uart *uart) {
    avr_t *avr = chip.avr;
    const avr_uart_t *io = uart->io;
    uint8_t coding[3];
    coding_of(uart, coding);
    uint32_t divisor = avr_regbit_get(avr, io->ubrrl) | (uint32_t)avr_regbit_get(avr, io->ubrrh) << 8;
    uint32_t bit = (avr_regbit_get(avr, io->u2x) ? 8 : 16) * (divisor + 1);
    return (avr_cycle_count_t)bit * (1u + coding[0] + (coding[1] != 0) + coding[2]);
}

void uart_tell_coding(struct uart *uart) {
    uint8_t coding[3];
    uint32_t baud = baud_of(uart);
    coding_of(uart, coding);
    uint32_t packed = (uint32_t)coding[0] << 16 | (uint32_t)coding[1] << 8 | coding[2];
    /* simavr begins with a transmitter that is on; a program sets a rate first. */
    bool is_set = avr_regbit_get(chip.avr, uart->io->rxen) || baud != chip.avr->frequency / 16;
    if (uart->port < 0 || !is_set || (baud == uart->told_baud && packed == uart->told_coding))
        return;
    uart->told_baud = baud;
    uart->told_coding = packed;
    uint8_t event[8] = {CODING, (uint8_t)baud, (uint8_t)(baud >> 8), (uint8_t)(baud >> 16),
                        (uint8_t)(baud >> 24), coding[0], coding[1], coding[2]};
    wire_item(ITEM_LINE, (uint8_t)uart->port, chip.now_ns, event, sizeof event);
}

/* What a port without a wire sends is text for people. */
static void show(struct uart *uart, uint8_t byte) {
    if (byte != '\n' && byte != '\r')
        uart->line[uart->line_len++] = byte >= ' ' && byte < 0x7F ? (char)byte : '.';
    if ((byte == '\n' || uart->line_len == sizeof uart->line - 1) && uart->line_len > 0) {
        fprintf(stderr, "%s: %.*s\n", uart->name, (int)uart->line_len, uart->line);
        uart->line_len = 0;
    }
}

/* The shift register has taken the character: there is room for the next one. */
static avr_cycle_count_t room(struct avr_t *avr, avr_cycle_count_t when, void *param) {
    struct uart *uart = param;
    (void)when;
    if (avr_regbit_get(avr, uart->io->txen) && uart->io->udrc.vector)
        avr_raise_interrupt(avr, &uart->io->udrc);
    return 0;
}

/* The program wrote a character. Behind this, simavr counts its time with `cycles_per_byte`. */
static void on_output(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct uart *uart = param;
    avr_t *avr = chip.avr;
    uint8_t byte = (uint8_t)value;
    (void)irq;
    uart->io->cycles_per_byte = cycles_per_byte(uart);
    avr_cycle_count_t start = uart->free_at > avr->cycle ? uart->free_at : avr->cycle;
    uart->free_at = start + uart->io->cycles_per_byte;
    avr_cycle_timer_register(avr, start - avr->cycle + 2, room, uart);
    uart->is_used = true;
    if (uart->port < 0) {
        show(uart, byte);
        return;
    }
    uart_tell_coding(uart);
    wire_item(ITEM_BYTES, (uint8_t)uart->port, output_ns(start), &byte, 1);
}

/* Hands simavr the next character; it sets the flag two cycles later. */
static void hand_over(struct uart *uart) {
    avr_uart_t *io = uart->io;
    bool is_empty = io->input.read == io->input.write;
    if (uart->waiting_len == 0 || !is_empty)
        return;
    uint8_t byte = uart->waiting[0];
    uart->waiting_len--;
    memmove(uart->waiting, uart->waiting + 1, uart->waiting_len);
    io->cycles_per_byte = 2;
    avr_raise_irq(io->io.irq + UART_IRQ_INPUT, byte);
    io->cycles_per_byte = cycles_per_byte(uart);
}

/* simavr calls this whenever its own buffer is empty. */
static void on_room_inside(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    hand_over(param);
}

/* Time after which a program that uses a receiver has turned it on. */
#define STARTED_NS NS_PER_S

void uart_receive(struct uart *uart, const uint8_t *bytes, size_t len) {
    avr_t *avr = chip.avr;
    if (!avr_regbit_get(avr, uart->io->rxen)) {
        uart->waiting_len = 0;
        if (!uart->is_used && !uart->is_told && chip.now_ns >= STARTED_NS) {
            uart->is_told = true;
            note(ITEM_FAULT_OR_NOTE, "receiver-off", "a byte came to %s, which the firmware does not use",
                 uart->name);
        }
        return;
    }
    uart->is_used = true;
    for (size_t i = 0; i < len; i++) {
        /* One character of three is in simavr's buffer. */
        bool is_empty = uart->io->input.read == uart->io->input.write;
        if (uart->waiting_len + !is_empty == sizeof uart->waiting) {
            /* The shift register's character gives way, as the data sheet says. */
            uart->waiting[uart->waiting_len - 1] = bytes[i];
            avr_regbit_set(avr, uart->io->dor);
        } else {
            uart->waiting[uart->waiting_len++] = bytes[i];
        }
        hand_over(uart);
    }
}

void uart_disturb(struct uart *uart, uint8_t event) {
    avr_uart_t *io = uart->io;
    bool is_empty = io->input.read == io->input.write;
    /* A break is a character 00 without a stop bit. */
    if (event == BREAK && avr_regbit_get(chip.avr, io->rxen) && is_empty) {
        io->cycles_per_byte = 2;
        avr_raise_irq(io->io.irq + UART_IRQ_INPUT, UART_INPUT_FE);
        io->cycles_per_byte = cycles_per_byte(uart);
    } else if (event == PARITY_ERROR) {
        avr_regbit_set(chip.avr, io->upe);
    }
}

void uart_reset(struct uart *uart) {
    if (!uart->io)
        return;
    uart->waiting_len = 0;
    uart->free_at = 0;
}

void uart_attach(struct uart *uart) {
    uint32_t no_flags = 0;
    avr_ioctl(chip.avr, AVR_IOCTL_UART_SET_FLAGS(uart->io->name), &no_flags);
    avr_irq_t *irq = uart->io->io.irq;
    avr_irq_register_notify(irq + UART_IRQ_OUTPUT, on_output, uart);
    avr_irq_register_notify(irq + UART_IRQ_OUT_XON, on_room_inside, uart);
}
