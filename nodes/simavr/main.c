/* Requests of the rig, one after the other. usage: hilrig-simavr [--mcus] */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "node.h"

enum { ITEM_HEAD = 12, EXCHANGE_HEAD = 10 };

/* The chips that boards may name. */
static const char *const MCUS[] = {"atmega328p", "atmega2560", "atmega32u4", "atmega1284p",
                                   "atmega328",  "atmega168p", "atmega1280", "atmega644p",
                                   "atmega1284", "atmega32",   "atmega128",  "atmega8"};

static void fault(const struct item *item) {
    static const char reset[] = "reset", off[] = "off";
    if (item->len < 9)
        return;
    bool begins = item->payload[0] != 0;
    const char *name = (const char *)item->payload + 9;
    size_t len = item->len - 9u;
    if (len == sizeof reset - 1 && memcmp(name, reset, len) == 0 && begins && !chip.is_off) {
        restart(false);
    } else if (len == sizeof off - 1 && memcmp(name, off, len) == 0) {
        if (chip.is_off && !begins)
            restart(true);
        else if (begins)
            pins_reset();
        chip.is_off = begins;
    }
}

static void apply(const struct item *item) {
    struct port *port = item->port < chip.port_count ? &chip.ports[item->port] : NULL;
    if (item->kind == ITEM_FAULT_OR_NOTE) {
        fault(item);
    } else if (item->kind == ITEM_GIVEN_OR_VIOLATION && item->len == 8) {
        pins_give(item->port, wire_f64(item->payload));
    } else if (chip.is_off) {
        return;
    } else if (item->kind == ITEM_LINE && item->len > 0 && port && port->unit == UNIT_UART) {
        uart_disturb(&chip.uarts[port->number], item->payload[0]);
    } else if (item->kind == ITEM_BYTES && port) {
        if (port->unit == UNIT_UART)
            uart_receive(&chip.uarts[port->number], item->payload, item->len);
        else if (port->unit == UNIT_TWI)
            twi_receive(item->port, item->payload, item->len);
        else if (port->unit == UNIT_SPI)
            spi_receive(item->payload, item->len);
    }
}

static void exchange(const uint8_t *body, uint32_t len) {
    if (len < EXCHANGE_HEAD)
        refuse("an exchange of %u bytes, expected at least %d", len, EXCHANGE_HEAD);
    uint64_t now = wire_u64(body);
    unsigned count = body[8] | (unsigned)body[9] << 8;
    if (now < chip.now_ns || now >= NEVER / 2)
        refuse("an exchange at %llu ns behind one at %llu ns", (unsigned long long)now,
               (unsigned long long)chip.now_ns);
    wire_clear();
    uint64_t since = chip.now_ns;
    /* What is put out on the way is for the rig's present or later. */
    chip.now_ns = now;
    uint32_t at = EXCHANGE_HEAD;
    for (unsigned i = 0; i < count; i++) {
        if (len - at < ITEM_HEAD)
            refuse("an exchange whose items do not fit into it");
        struct item item = {
            .kind = body[at],
            .port = body[at + 1],
            .len = (uint16_t)(body[at + 2] | body[at + 3] << 8),
            .at_ns = wire_u64(body + at + 4),
            .payload = body + at + ITEM_HEAD,
        };
        if (len - at - ITEM_HEAD < item.len)
            refuse("an exchange whose items do not fit into it");
        at += ITEM_HEAD + item.len;
        uint64_t when = item.at_ns < since ? since : item.at_ns > now ? now : item.at_ns;
        run_until(when, now);
        apply(&item);
    }
    run_until(now, now);
    for (int i = 0; i < UARTS_MAX; i++)
        if (chip.uarts[i].io)
            uart_tell_coding(&chip.uarts[i]);
    pins_report();
    wire_answer(next_exchange());
}

static int list_mcus(void) {
    for (size_t i = 0; i < sizeof MCUS / sizeof *MCUS; i++)
        if (avr_make_mcu_by_name(MCUS[i]))
            puts(MCUS[i]);
    return 0;
}

int main(int argc, char **argv) {
    if (argc == 2 && strcmp(argv[1], "--mcus") == 0)
        return list_mcus();
    if (argc != 1)
        refuse("unknown argument \"%s\", expected none or --mcus", argv[1]);
    /* simavr prints to standard output, which is the rig's. */
    int out = dup(STDOUT_FILENO);
    if (out < 0 || dup2(STDERR_FILENO, STDOUT_FILENO) < 0)
        refuse("standard output cannot be kept for the rig");
    setvbuf(stderr, NULL, _IOLBF, 0);
    setvbuf(stdout, NULL, _IOLBF, 0);
    wire_begin(STDIN_FILENO, out);
    const uint8_t *body;
    uint32_t len;
    bool is_set_up = false;
    for (int type; (type = wire_read(&body, &len)) != 0;) {
        if (type == 'E')
            return 0;
        if (type == 'H' && !is_set_up) {
            const char *error = NULL;
            const struct json *hello = json_read((const char *)body, len, &error);
            if (!hello)
                refuse("the greeting is not JSON: %s", error);
            setup(hello);
            is_set_up = true;
        } else if (type == 'X' && is_set_up) {
            exchange(body, len);
        } else {
            refuse("a request of type %d, expected H first, then X or E", type);
        }
    }
    return 0;
}
