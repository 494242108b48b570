/* A node program of hilrig: an AVR microcontroller of simavr that runs an unmodified ELF file.
 *
 *   rig --items--> [due inputs] --> UART, TWI, SPI, pins --> program --> outputs --items--> rig
 *
 * Time of the chip is its cycle counter, which never runs ahead of the rig. What the program puts
 * out at a moment reaches the rig one slice later: spacing is exact, and no answer is in the past. */
#ifndef HILRIG_NODE_H
#define HILRIG_NODE_H

#include <stdbool.h>
#include <stdint.h>

#include <avr_adc.h>
#include <avr_eeprom.h>
#include <avr_extint.h>
#include <avr_ioport.h>
#include <avr_spi.h>
#include <avr_timer.h>
#include <avr_twi.h>
#include <avr_uart.h>
#include <sim_avr.h>
#include <sim_cycle_timers.h>
#include <sim_interrupts.h>

#include "json.h"

enum { PORTS_MAX = 16, PINS_MAX = 128, NAME_MAX_LEN = 64, UARTS_MAX = 4, WHEELS_MAX = 8 };

static const uint64_t NEVER = UINT64_MAX;
static const uint64_t NS_PER_S = 1000000000;

/* Kinds of items. */
enum item_kind {
    ITEM_BYTES = 1,
    ITEM_LINE = 2,
    ITEM_FAULT_OR_NOTE = 3,
    ITEM_GIVEN_OR_VIOLATION = 4,
    ITEM_OUTPUT = 5,
};

struct item {
    uint8_t kind;
    uint8_t port;
    uint16_t len;
    uint64_t at_ns;
    const uint8_t *payload;
};

/* What a port of the rig is connected to. */
enum unit { UNIT_NONE, UNIT_UART, UNIT_TWI, UNIT_SPI };

struct port {
    char name[NAME_MAX_LEN];
    enum unit unit;
    unsigned number;
};

/* A pin of the board; `duty` of a timer's output, or the level that the program wrote. */
struct pin {
    char name[NAME_MAX_LEN];
    char letter;
    uint8_t bit;
    /* Channel of the converter; -1 if it has none. */
    int channel;
    avr_timer_t *timer;
    int comp;
    /* Number of the output: its level or duty; the next one is the width of its last pulse. */
    int output;
    double value;
    avr_cycle_count_t rose;
    unsigned edges;
};

/* A motor driver with a pin for its power and two for its direction; its output is -1 to 1. */
struct bridge {
    char name[NAME_MAX_LEN];
    int power, forward, backward;
    int output;
    double value;
};

/* A wheel's encoder: two contacts, a quarter of a turn apart, that follow a count. */
struct encoder {
    char name[NAME_MAX_LEN];
    int a, b;
    bool is_begun;
    int64_t count;
};

/* A quantity that the rig gives, by its number there: of a pin, or of an encoder. */
struct given {
    int pin;
    int encoder;
};

struct uart {
    avr_uart_t *io;
    /* Port of the rig; -1: what it sends is shown in the log. */
    int port;
    char name[NAME_MAX_LEN];
    /* Received, not yet taken: two characters and one in the shift register. */
    uint8_t waiting[3];
    unsigned waiting_len;
    avr_cycle_count_t free_at;
    uint32_t told_baud;
    uint32_t told_coding;
    char line[256];
    unsigned line_len;
    /* Whether the program has used it, and whether the log says that it does not. */
    bool is_used;
    bool is_told;
};

/* A chip of the rig on the bus: each has a port of its own, and all hear each address. */
struct chip_on_bus {
    int port;
    bool is_asked;
    /* The answer to a question that was given up may come until then. */
    bool is_late;
    avr_cycle_count_t late_until;
    /* It came while the present question waited for its own. */
    bool had_late;
    uint8_t answer[258];
    unsigned answer_len;
};

struct twi {
    avr_twi_t *io;
    struct chip_on_bus chips[PORTS_MAX];
    int chip_count;
    /* The chip that acknowledged. */
    int port;
    bool touched;
    bool is_open;
    /* The log says that this transaction is too long. */
    bool is_told;
    uint8_t address;
    uint8_t written[250];
    unsigned written_len;
    uint8_t read[255];
    unsigned read_len;
    unsigned taken;
    /* The clock is held until the chip's answer. */
    bool held;
    avr_cycle_timer_t resume;
    avr_cycle_count_t begun;
    avr_cycle_count_t deadline;
};

struct spi {
    avr_spi_t *io;
    int port;
    bool held;
    avr_cycle_count_t deadline;
};

struct chip {
    avr_t *avr;
    char name[NAME_MAX_LEN];
    char mcu[NAME_MAX_LEN];
    char elf[4096];
    uint64_t slice_ns;
    uint64_t now_ns;
    int gdb_port;
    /* Turns of a loop that waits. */
    bool leaves_out;
    bool is_off;
    bool is_crashed;
    bool was_reset;
    unsigned resets;
    char last_error[200];
    struct port ports[PORTS_MAX];
    int port_count;
    struct uart uarts[UARTS_MAX];
    struct twi twi;
    struct spi spi;
    avr_adc_t *adc;
    avr_extint_t *external;
    uint8_t adc_source[64];
    double volts[16];
    double vcc;
    double aref;
    struct pin pins[PINS_MAX];
    int pin_count;
    int output_count;
    struct bridge bridges[WHEELS_MAX];
    int bridge_count;
    struct encoder encoders[WHEELS_MAX];
    int encoder_count;
    struct given given[PINS_MAX * 2];
    int given_count;
};

extern struct chip chip;

/* wire.c: messages. */
void wire_begin(int in, int out);
/* Type of the next message, its body in `body` and `len`; 0 at the end of the input. */
int wire_read(const uint8_t **body, uint32_t *len);
void wire_send(uint8_t type, const void *body, uint32_t len);
/* Starts, extends and sends the answer to an exchange. */
void wire_clear(void);
void wire_item(uint8_t kind, uint8_t port, uint64_t at_ns, const void *payload, size_t len);
void wire_answer(uint64_t next_ns);
/* Whether the rig has closed its end. */
bool wire_is_gone(void);
uint64_t wire_u64(const uint8_t *from);
double wire_f64(const uint8_t *from);

/* setup.c: from the greeting to a chip that is ready to run. Ends the process with a sentence. */
void setup(const struct json *hello);
_Noreturn void refuse(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* run.c: time. */
avr_cycle_count_t cycles_of(uint64_t ns);
uint64_t ns_of(avr_cycle_count_t cycles);
/* When what happens now reaches the rig. */
uint64_t output_ns(avr_cycle_count_t when);
void run_until(uint64_t ns, uint64_t now_ns);
uint64_t next_exchange(void);
void restart(bool is_power_on);
void begin_running(void);
/* Called after each write to a register with its old value and the written one. */
typedef void (*written)(avr_io_addr_t address, uint8_t old, uint8_t value, void *param);
void after_write(avr_io_addr_t address, written after, void *param);
/* A one written to the flag of this interrupt clears it, as the data sheets say. */
void clear_by_one(avr_int_vector_t *vector);
/* The register holds nothing but flags. */
void flags_only(avr_io_addr_t address);
void note(uint8_t kind, const char *rule, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
/* power.c: time of the EEPROM, and clocks that stand in sleep. */
void power_begin(void);
/* Puts the chip to sleep again if only units without a clock have woken it. */
void sleep_on(void);

/* The timer of the chip's unit `param`; NULL if none runs. */
avr_cycle_timer_slot_t *timer_of(const void *param);

/* idle.c: leaves out what a waiting program does up to `end`, or the next event. */
void idle_look(avr_cycle_count_t end);

/* uart.c */
void uart_attach(struct uart *uart);
void uart_receive(struct uart *uart, const uint8_t *bytes, size_t len);
void uart_disturb(struct uart *uart, uint8_t event);
void uart_reset(struct uart *uart);
void uart_tell_coding(struct uart *uart);

/* bus.c */
void twi_attach(void);
void twi_receive(int port, const uint8_t *bytes, size_t len);
/* After each step: true bit times, and the clock that a chip holds. */
void twi_settle(void);
void twi_reset(void);
void spi_attach(void);
void spi_receive(const uint8_t *bytes, size_t len);
void spi_settle(void);
avr_cycle_count_t bus_deadline(void);

/* pins.c */
void pins_attach(void);
void pins_give(int number, double value);
/* Levels and duties that changed since the last exchange. */
void pins_report(void);
void pins_reset(void);

#endif
