/* From the rig's greeting to a chip that is ready to run. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "elf.h"
#include "node.h"

/* Reach of the program memory's and the data memory's addresses: a program that has gone astray
 * reads nothing, rather than what lies behind. */
enum { FLASH_REACH = 1 << 24, DATA_REACH = 1 << 17 };

_Noreturn void refuse(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fprintf(stderr, "error: simavr: ");
    vfprintf(stderr, format, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
    exit(2);
}

/* What simavr says is shown without its colours, and only so much of it. */
static void log_of_simavr(struct avr_t *avr, const int level, const char *format, va_list rest) {
    static unsigned lines;
    (void)avr;
    if (level > LOG_ERROR)
        return;
    char text[300], *to = chip.last_error;
    vsnprintf(text, sizeof text, format, rest);
    /* Says nothing that the line before it does not. */
    if (strstr(text, "sadly"))
        return;
    for (const char *at = text; *at && to < chip.last_error + sizeof chip.last_error - 1; at++) {
        if (*at == '\033')
            at += strcspn(at, "m") - (strchr(at, 'm') ? 0 : 1);
        else if (*at != '\n')
            *to++ = *at;
    }
    *to = '\0';
    if (lines++ < 20)
        fprintf(stderr, "simavr: %s\n", chip.last_error);
}

/* A name that is cut would be another one. */
static void copy(char *to, size_t size, const char *from) {
    if ((size_t)snprintf(to, size, "%s", from) >= size)
        refuse("\"%.40s...\" is too long, expected at most %zu characters", from, size - 1);
}

static const char *needed(const struct json *object, const char *key) {
    const char *text = json_text(object, key);
    if (!text)
        refuse("settings: \"%s\" is missing, expected a text", key);
    return text;
}

static void read_board(const struct json *settings) {
    const struct json *board = json_get(settings, "board");
    if (!board || board->kind != JSON_OBJECT)
        refuse("settings: \"board\" is missing; hilrig gives it from boards/NAME.toml");
    copy(chip.mcu, sizeof chip.mcu, needed(board, "mcu"));
    double clock = json_number(board, "clock_hz", 16e6);
    if (!(clock >= 32768 && clock <= 20e6))
        refuse("board.clock_hz is %g, expected 32768 to 20000000", clock);
    chip.vcc = json_number(board, "vcc_volts", 5);
    chip.aref = json_number(board, "aref_volts", chip.vcc);
    if (!(chip.vcc >= 1.8 && chip.vcc <= 5.5) || !(chip.aref >= 1 && chip.aref <= 5.5))
        refuse("board.vcc_volts is %g and aref_volts %g, expected 1.8 to 5.5 and 1 to 5.5", chip.vcc,
               chip.aref);
    double slice = json_number(settings, "slice_us", 200);
    if (!(slice >= 10 && slice <= 10000))
        refuse("slice_us is %g, expected 10 to 10000", slice);
    chip.slice_ns = (uint64_t)(slice * 1000);
    const struct json *leaves_out = json_get(settings, "leave_out_idle");
    chip.leaves_out = !leaves_out || leaves_out->number != 0;
    chip.gdb_port = (int)json_number(settings, "gdb", 0);
    if (chip.gdb_port < 0 || chip.gdb_port > 65535)
        refuse("gdb is %d, expected a port of TCP, 1 to 65535", chip.gdb_port);
    copy(chip.elf, sizeof chip.elf, needed(settings, "elf"));

    avr_global_logger_set(log_of_simavr);
    chip.avr = avr_make_mcu_by_name(chip.mcu);
    if (!chip.avr)
        refuse("board.mcu is \"%s\", which this simavr does not know; hilrig-simavr --mcus lists them",
               chip.mcu);
    avr_init(chip.avr);
    chip.avr->log = LOG_ERROR;
    chip.avr->frequency = (uint32_t)clock;
    chip.avr->vcc = chip.avr->avcc = (uint32_t)(chip.vcc * 1000);
    chip.avr->aref = (uint32_t)(chip.aref * 1000);
}

static void *reach(uint8_t *old, size_t used, size_t size) {
    uint8_t *wide = calloc(1, size);
    if (!wide)
        refuse("no memory for the chip's memories");
    memcpy(wide, old, used);
    free(old);
    return wide;
}

static void load_firmware(void) {
    avr_t *avr = chip.avr;
    avr->flash = reach(avr->flash, (size_t)avr->flashend + 1, FLASH_REACH);
    avr->data = reach(avr->data, (size_t)avr->ramend + 1, DATA_REACH);
    size_t eeprom_size = (size_t)avr->e2end + 1;
    uint8_t *eeprom = malloc(eeprom_size);
    if (!eeprom)
        refuse("no memory for the EEPROM");
    memset(eeprom, 0xFF, eeprom_size);
    struct memories memories = {
        .flash = avr->flash,
        .flash_size = (size_t)avr->flashend + 1,
        .eeprom = eeprom,
        .eeprom_size = eeprom_size,
    };
    char error[512];
    if (elf_load(chip.elf, &memories, error, sizeof error) != 0)
        refuse("%s", error);
    /* "p" is for picoPower: the same chip to a program. */
    size_t known = strlen(memories.built_for);
    if (known > 0 && strncmp(memories.built_for, chip.mcu, known) != 0 &&
        strncmp(memories.built_for, chip.mcu, strlen(chip.mcu)) != 0)
        refuse("%s: was built for %s, the board has %s; choose its board, or build it with -mmcu=%s",
               chip.elf, memories.built_for, chip.mcu, chip.mcu);
    avr_eeprom_desc_t all = {.ee = eeprom, .offset = 0, .size = (uint32_t)eeprom_size};
    avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &all);
    free(eeprom);
    avr->codeend = avr->flashend;
}

static void find_units(const struct json *board) {
    for (int i = 0; i < UARTS_MAX; i++)
        chip.uarts[i].port = -1;
    chip.spi.port = -1;
    for (avr_io_t *io = chip.avr->io_port; io; io = io->next) {
        if (strcmp(io->kind, "uart") == 0) {
            unsigned number = (unsigned)(((avr_uart_t *)io)->name - '0');
            if (number < UARTS_MAX) {
                chip.uarts[number].io = (avr_uart_t *)io;
                snprintf(chip.uarts[number].name, NAME_MAX_LEN, "uart%u", number);
            }
        } else if (strcmp(io->kind, "twi") == 0) {
            chip.twi.io = (avr_twi_t *)io;
        } else if (strcmp(io->kind, "spi") == 0) {
            chip.spi.io = (avr_spi_t *)io;
        } else if (strcmp(io->kind, "adc") == 0) {
            chip.adc = (avr_adc_t *)io;
        } else if (strcmp(io->kind, "extint") == 0) {
            chip.external = (avr_extint_t *)io;
        }
    }
    const struct json *uarts = json_get(board, "uarts");
    for (const struct json *at = uarts ? uarts->first : NULL; at; at = at->next)
        if (at->key && at->kind == JSON_NUMBER && at->number >= 0 && at->number < UARTS_MAX)
            copy(chip.uarts[(int)at->number].name, NAME_MAX_LEN, at->key);
}

/* Ports of the rig, in its order, and what of the chip each is connected to. */
static void read_ports(const struct json *hello, const struct json *wires) {
    const struct json *ports = json_get(hello, "ports");
    for (const struct json *at = ports ? ports->first : NULL; at; at = at->next) {
        if (chip.port_count == PORTS_MAX)
            refuse("the rig has more than %d ports", PORTS_MAX);
        int index = chip.port_count++;
        struct port *port = &chip.ports[index];
        const char *name = json_text(at, "name");
        copy(port->name, sizeof port->name, name ? name : "");
        const struct json *wire = json_get(wires, port->name);
        const char *unit = json_text(wire, "unit");
        if (!unit)
            continue;
        double number = json_number(wire, "number", 0);
        port->number = number >= 0 && number < UARTS_MAX ? (unsigned)number : UARTS_MAX;
        bool is_there;
        if (strcmp(unit, "uart") == 0) {
            port->unit = UNIT_UART;
            is_there = port->number < UARTS_MAX && chip.uarts[port->number].io;
            if (is_there)
                chip.uarts[port->number].port = index;
        } else if (strcmp(unit, "twi") == 0) {
            port->unit = UNIT_TWI;
            is_there = chip.twi.io;
            chip.twi.chips[chip.twi.chip_count++] = (struct chip_on_bus){.port = index};
        } else if (strcmp(unit, "spi") == 0) {
            port->unit = UNIT_SPI;
            is_there = chip.spi.io && chip.spi.port < 0;
            chip.spi.port = index;
        } else {
            refuse("wires.%s.unit is \"%s\", expected uart, twi or spi", port->name, unit);
        }
        if (!is_there)
            refuse("wires.%s: %s %g of a %s does not exist, or is taken; choose another port of the "
                   "board",
                   port->name, unit, number, chip.mcu);
    }
}

static int pin_named(const char *name) {
    for (int i = 0; i < chip.pin_count; i++)
        if (strcmp(chip.pins[i].name, name) == 0)
            return i;
    return -1;
}

static void read_pins(const struct json *board) {
    const struct json *pins = json_get(board, "pins");
    for (const struct json *at = pins ? pins->first : NULL; at; at = at->next) {
        const char *place = json_text(at, "at");
        if (chip.pin_count == PINS_MAX || !at->key)
            refuse("board.pins: expected a table of at most %d pins", PINS_MAX);
        if (!place || place[0] < 'A' || place[0] > 'L' || place[1] < '0' || place[1] > '7' || place[2])
            refuse("board.pins.%s.at is \"%s\", expected a port and a bit, as \"B5\"", at->key,
                   place ? place : "");
        double channel = json_number(at, "channel", -1);
        if (!(channel >= -1 && channel <= 15))
            refuse("board.pins.%s.channel is %g, expected 0 to 15", at->key, channel);
        struct pin *pin = &chip.pins[chip.pin_count++];
        copy(pin->name, sizeof pin->name, at->key);
        pin->letter = place[0];
        pin->bit = (uint8_t)(place[1] - '0');
        pin->channel = (int)channel;
        pin->output = -1;
    }
}

/* The pin that `key` of a motor driver or an encoder names. */
static int pin_of(const struct json *part, const char *what, const char *key) {
    const char *name = json_text(part, key);
    int pin = name ? pin_named(name) : -1;
    if (pin < 0)
        refuse("%s.%s.%s is \"%s\", expected a pin of the board", what, part->key, key,
               name ? name : "");
    return pin;
}

/* Motor drivers, encoders, and the values that the rig gives. */
static void read_wheels(const struct json *hello, const struct json *settings) {
    const struct json *bridges = json_get(settings, "bridges");
    for (const struct json *at = bridges ? bridges->first : NULL; at; at = at->next) {
        if (chip.bridge_count == WHEELS_MAX || !at->key)
            refuse("bridges: expected a table of at most %d", WHEELS_MAX);
        struct bridge *bridge = &chip.bridges[chip.bridge_count++];
        copy(bridge->name, sizeof bridge->name, at->key);
        bridge->power = pin_of(at, "bridges", "power");
        bridge->forward = pin_of(at, "bridges", "forward");
        bridge->backward = pin_of(at, "bridges", "backward");
        bridge->output = chip.output_count++;
    }
    const struct json *encoders = json_get(settings, "encoders");
    for (const struct json *at = encoders ? encoders->first : NULL; at; at = at->next) {
        if (chip.encoder_count == WHEELS_MAX || !at->key)
            refuse("encoders: expected a table of at most %d", WHEELS_MAX);
        struct encoder *encoder = &chip.encoders[chip.encoder_count++];
        copy(encoder->name, sizeof encoder->name, at->key);
        encoder->a = pin_of(at, "encoders", "a");
        encoder->b = pin_of(at, "encoders", "b");
    }
    const struct json *quantities = json_get(hello, "quantities");
    for (const struct json *at = quantities ? quantities->first : NULL; at; at = at->next) {
        const char *name = at->kind == JSON_STRING ? at->string : "?";
        struct given given = {pin_named(name), -1};
        for (int i = 0; i < chip.encoder_count; i++)
            if (strcmp(chip.encoders[i].name, name) == 0)
                given.encoder = i;
        if ((given.pin < 0 && given.encoder < 0) || chip.given_count == PINS_MAX * 2)
            refuse("the rig gives a value \"%s\", which is neither a pin of the board nor one of "
                   "encoders",
                   name);
        chip.given[chip.given_count++] = given;
    }
}

/* Outputs are numbered in pairs: the level or duty of a pin, and the width of its last pulse. */
static void choose_outputs(const struct json *settings) {
    const struct json *outputs = json_get(settings, "outputs");
    for (const struct json *at = outputs ? outputs->first : NULL; at; at = at->next) {
        int pin = at->kind == JSON_STRING ? pin_named(at->string) : -1;
        if (pin < 0)
            refuse("outputs: \"%s\" is no pin of the board",
                   at->kind == JSON_STRING ? at->string : "?");
        if (chip.pins[pin].output < 0 && chip.output_count < 240) {
            chip.pins[pin].output = chip.output_count;
            chip.output_count += 2;
        }
    }
}

/* The answer to the greeting. */
static char text[65536];
static size_t text_len;

static void put(const char *format, ...) __attribute__((format(printf, 1, 2)));

static void put(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    text_len += (size_t)vsnprintf(text + text_len, sizeof text - text_len, format, arguments);
    va_end(arguments);
    if (text_len >= sizeof text)
        refuse("the board has too many names, expected fewer pins or shorter names");
}

/* A name as a text of JSON. */
static void put_name(const char *before, const char *name, const char *after) {
    put("%s\"", before);
    for (const unsigned char *at = (const unsigned char *)name; *at; at++) {
        if (*at == '"' || *at == '\\')
            put("\\%c", *at);
        else if (*at < ' ')
            put("\\u%04x", *at);
        else
            put("%c", *at);
    }
    put("%s\"", after);
}

static void answer_hello(void) {
    put("{\"hilrig_node\": 1, \"save\": false, \"faults\": [\"reset\", \"off\"], \"outputs\": [");
    const char *comma = "";
    for (int number = 0; number < chip.output_count; number++) {
        for (int i = 0; i < chip.pin_count; i++)
            if (chip.pins[i].output == number) {
                put_name(comma, chip.pins[i].name, "");
                put_name(", ", chip.pins[i].name, "_us");
            }
        for (int i = 0; i < chip.bridge_count; i++)
            if (chip.bridges[i].output == number)
                put_name(comma, chip.bridges[i].name, "");
        comma = ", ";
    }
    /* The buses keep their times by themselves: questions to a chip travel at once. */
    comma = "";
    put("], \"ports\": [");
    for (int i = 0; i < chip.port_count; i++) {
        if (chip.ports[i].unit != UNIT_TWI && chip.ports[i].unit != UNIT_SPI)
            continue;
        put("%s{\"name\": ", comma);
        put_name("", chip.ports[i].name, "");
        put(", \"rate\": 10000000, \"format\": \"8N1\"}");
        comma = ", ";
    }
    put("]}");
    wire_send('h', text, (uint32_t)text_len);
}

void setup(const struct json *hello) {
    double version = json_number(hello, "hilrig_node", 0);
    if (version != 1)
        refuse("the rig speaks version %g of the protocol, this program 1; update both together",
               version);
    const struct json *settings = json_get(hello, "settings");
    const struct json *board = json_get(settings, "board");
    const char *name = json_text(hello, "name");
    copy(chip.name, sizeof chip.name, name ? name : "firmware");
    read_board(settings);
    load_firmware();
    find_units(board);
    power_begin();
    read_ports(hello, json_get(settings, "wires"));
    read_pins(board);
    choose_outputs(settings);
    read_wheels(hello, settings);
    for (int i = 0; i < UARTS_MAX; i++)
        if (chip.uarts[i].io)
            uart_attach(&chip.uarts[i]);
    if (chip.twi.io)
        twi_attach();
    if (chip.spi.io)
        spi_attach();
    pins_attach();
    begin_running();
    answer_hello();
}
