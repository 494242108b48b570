/* Time of the chip: runs it to a moment of the rig, finds out when it wants to run again. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "node.h"

/* These do not stand by themselves. */
#include <sim_core.h>
#include <sim_gdb.h>

struct chip chip;

static void (*reset_of_core)(struct avr_t *avr);

avr_cycle_count_t cycles_of(uint64_t ns) {
    uint64_t f = chip.avr->frequency;
    return ns / NS_PER_S * f + ns % NS_PER_S * f / NS_PER_S;
}

uint64_t ns_of(avr_cycle_count_t cycles) {
    uint64_t f = chip.avr->frequency;
    return cycles / f * NS_PER_S + (cycles % f * NS_PER_S + f - 1) / f;
}

uint64_t output_ns(avr_cycle_count_t when) {
    uint64_t at = ns_of(when) + chip.slice_ns;
    return at > chip.now_ns ? at : chip.now_ns;
}

void note(uint8_t kind, const char *rule, const char *format, ...) {
    char text[512];
    int rule_len = snprintf(text, 64, "%s", rule);
    va_list arguments;
    va_start(arguments, format);
    size_t start = (size_t)rule_len + 1;
    vsnprintf(text + start, sizeof text - start, format, arguments);
    va_end(arguments);
    wire_item(kind, 0, output_ns(chip.avr->cycle), text, start + strlen(text + start));
}

avr_cycle_timer_slot_t *timer_of(const void *param) {
    avr_cycle_timer_slot_t *at = chip.avr->cycle_timers.timer;
    while (at && at->param != param)
        at = at->next;
    return at;
}

/* What follows a write to a register. simavr itself shares only six registers of a chip. */
static struct write {
    avr_io_write_t before;
    void *before_param;
    written after;
    void *param;
} writes[32];

static void on_write(struct avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    const struct write *write = param;
    uint8_t old = avr->data[address];
    if (write->before)
        write->before(avr, address, value, write->before_param);
    else
        avr->data[address] = value;
    write->after(address, old, value, write->param);
}

void after_write(avr_io_addr_t address, written after, void *param) {
    static size_t count;
    if (count == ARRAY_SIZE(writes))
        refuse("a %s has more units than this program follows", chip.mcu);
    struct write *write = &writes[count++];
    *write = (struct write){chip.avr->io[AVR_DATA_TO_IO(address)].w.c,
                            chip.avr->io[AVR_DATA_TO_IO(address)].w.param, after, param};
    chip.avr->io[AVR_DATA_TO_IO(address)].w.c = on_write;
    chip.avr->io[AVR_DATA_TO_IO(address)].w.param = write;
}

static void clear_flag(avr_io_addr_t address, uint8_t old, uint8_t value, void *param) {
    avr_int_vector_t *vector = param;
    (void)address;
    (void)old;
    if (!(value >> vector->raised.bit & 1))
        return;
    avr_clear_interrupt(chip.avr, vector);
    avr_regbit_clear(chip.avr, vector->raised);
}

void clear_by_one(avr_int_vector_t *vector) {
    after_write(vector->raised.reg, clear_flag, vector);
}

/* Flags without another use: a zero leaves them. */
static void keep_flags(avr_io_addr_t address, uint8_t old, uint8_t value, void *param) {
    (void)param;
    chip.avr->data[address] = old & (uint8_t)~value;
}

void flags_only(avr_io_addr_t address) {
    after_write(address, keep_flags, NULL);
}

/* The core's own part of a reset, whatever causes it: watchdog, reset pin, power. */
static void on_reset(struct avr_t *avr) {
    if (reset_of_core)
        reset_of_core(avr);
    chip.was_reset = true;
}

/* The units are reset behind the core's part. */
static void after_reset(void) {
    chip.was_reset = false;
    chip.resets++;
    for (int i = 0; i < UARTS_MAX; i++)
        uart_reset(&chip.uarts[i]);
    twi_reset();
    chip.spi.held = false;
    pins_reset();
}

void restart(bool is_power_on) {
    avr_t *avr = chip.avr;
    if (is_power_on)
        memset(avr->data, 0, (size_t)avr->ramend + 1);
    avr_reset(avr);
    avr_regbit_set(avr, is_power_on ? avr->reset_flags.porf : avr->reset_flags.extrf);
    chip.is_crashed = false;
    after_reset();
}

/* The rig's time passes as fast as it can: a chip that sleeps does not wait. */
static void no_sleep(avr_t *avr, avr_cycle_count_t how_long) {
    (void)avr;
    (void)how_long;
}

void begin_running(void) {
    avr_t *avr = chip.avr;
    reset_of_core = avr->reset;
    avr->reset = on_reset;
    if (chip.gdb_port > 0) {
        avr->gdb_port = chip.gdb_port;
        if (avr_gdb_init(avr) != 0)
            refuse("--gdb %d: the port cannot be opened; choose another one", chip.gdb_port);
        avr->state = cpu_Stopped;
        fprintf(stderr, "gdb: target remote :%d\n", chip.gdb_port);
    }
    avr->sleep = no_sleep;
}

/* One step with gdb's server: the rig waits while gdb holds the program. */
static bool held_by_gdb(void) {
    avr_t *avr = chip.avr;
    if (!avr->gdb)
        return false;
    /* The rig is gone: gdb would hold a program that nothing waits for. */
    if (wire_is_gone())
        exit(0);
    avr_gdb_processor(avr, avr->state == cpu_Stopped ? 10000 : 0);
    avr->run_cycle_limit = avr->run_cycle_count = 1;
    return avr->state == cpu_Stopped;
}

static void crashed(void) {
    chip.is_crashed = true;
    note(ITEM_GIVEN_OR_VIOLATION, "crash", "the firmware crashed at address 0x%04x%s%s",
         chip.avr->pc, chip.last_error[0] ? ": " : "", chip.last_error);
}

static void step(avr_cycle_count_t end) {
    avr_t *avr = chip.avr;
    avr_flashaddr_t at = avr->pc;
    avr_flashaddr_t next = at;
    bool is_step = avr->state == cpu_Step;
    if (is_step)
        avr->state = cpu_Running;
    avr_run_t run = avr->run;
    if (avr->state == cpu_Running)
        next = avr_run_one(avr);
    if (chip.twi.touched)
        twi_settle();
    if (!avr->gdb)
        avr->run_cycle_limit = end > avr->cycle ? end - avr->cycle : 1;
    bool was_asleep = avr->state == cpu_Sleeping;
    avr_cycle_count_t sleep = avr_cycle_timer_process(avr);
    if (was_asleep && avr->state == cpu_Running)
        sleep_on();
    avr->pc = next;
    if (avr->state == cpu_Sleeping) {
        avr_cycle_count_t left = end > avr->cycle ? end - avr->cycle : 1;
        if (sleep == 0)
            sleep = 1;
        avr->cycle += sleep < left ? sleep : left;
    }
    /* The watchdog asks for its reset by another `run`. */
    if (avr->run != run) {
        avr->run(avr);
        note(ITEM_FAULT_OR_NOTE, "watchdog-reset", "the watchdog reset the chip at address 0x%04x", at);
    }
    if (chip.was_reset)
        after_reset();
    else if ((avr->state == cpu_Running || avr->state == cpu_Sleeping) && avr->interrupt_state)
        avr_service_interrupts(avr);
    if (is_step && avr->state != cpu_Stopped)
        avr->state = cpu_StepDone;
    if (avr->state == cpu_Crashed || avr->state == cpu_Done)
        crashed();
}

/* Steps between two looks at the wire. A step is an instruction, or many. */
#define STEPS_UNSEEN (1 << 14)

/* Ends the program if the rig is gone: an exchange may ask for hours. */
static void look_at_wire(void) {
    static uint32_t steps;
    if (++steps % STEPS_UNSEEN == 0 && wire_is_gone())
        exit(0);
}

void run_until(uint64_t ns, uint64_t now_ns) {
    avr_t *avr = chip.avr;
    avr_cycle_count_t end = cycles_of(ns);
    while (avr->cycle < end) {
        if (chip.is_off || chip.is_crashed) {
            avr->cycle = end;
            break;
        }
        if (held_by_gdb())
            continue;
        look_at_wire();
        avr_cycle_count_t deadline = bus_deadline();
        avr_cycle_count_t stop = deadline < end ? deadline : end;
        step(stop);
        idle_look(stop);
        if (bus_deadline() <= avr->cycle) {
            twi_settle();
            spi_settle();
        }
    }
    chip.now_ns = now_ns;
}

/* Whether an event of a unit may wake the program: one of a timer without interrupts does not. */
static bool may_wake(const void *param) {
    avr_t *avr = chip.avr;
    for (avr_io_t *io = avr->io_port; io; io = io->next) {
        if ((const void *)io != param || strcmp(io->kind, "timer") != 0)
            continue;
        const avr_timer_t *timer = param;
        bool may = avr_regbit_get(avr, timer->overflow.enable) || avr_regbit_get(avr, timer->icr.enable);
        for (int i = 0; i < AVR_TIMER_COMP_COUNT; i++)
            may = may || avr_regbit_get(avr, timer->comp[i].interrupt.enable);
        return may;
    }
    return true;
}

uint64_t next_exchange(void) {
    avr_t *avr = chip.avr;
    if (chip.is_off || chip.is_crashed)
        return NEVER;
    if (avr->state != cpu_Sleeping || avr->interrupt_state)
        return chip.now_ns + chip.slice_ns;
    avr_cycle_count_t wakes = bus_deadline();
    avr_cycle_timer_slot_t *first = avr->cycle_timers.timer;
    while (first && !may_wake(first->param))
        first = first->next;
    if (first && first->when < wakes)
        wakes = first->when;
    if (wakes == NEVER)
        return NEVER;
    uint64_t at = ns_of(wakes) + chip.slice_ns;
    return at > chip.now_ns ? at : chip.now_ns + chip.slice_ns;
}
