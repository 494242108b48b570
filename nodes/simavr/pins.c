/* Pins: levels and pulses by the edges that the program makes, duties by the timers' registers,
 * inputs as levels and voltages. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "node.h"

/* Edges of a pin in one exchange; what is faster is a clock, of which only the level is told. */
enum { EDGES_MAX = 64 };

static avr_ioport_t *port_of(char letter) {
    for (avr_io_t *io = chip.avr->io_port; io; io = io->next) {
        avr_ioport_t *port = (avr_ioport_t *)io;
        if (strcmp(io->kind, "port") == 0 && port->name == letter)
            return port;
    }
    return NULL;
}

static void tell(struct pin *pin, double value, avr_cycle_count_t when) {
    if (pin->output < 0 || value == pin->value)
        return;
    pin->value = value;
    wire_item(ITEM_OUTPUT, (uint8_t)pin->output, output_ns(when), &value, sizeof value);
}

static bool is_driven(const struct pin *pin) {
    const avr_ioport_t *port = port_of(pin->letter);
    return port && (chip.avr->data[port->r_ddr] >> pin->bit & 1);
}

static bool timer_drives(const struct pin *pin) {
    return pin->timer && avr_regbit_get(chip.avr, pin->timer->comp[pin->comp].com) != 0;
}

static uint32_t word(avr_io_addr_t low, avr_io_addr_t high) {
    const uint8_t *data = chip.avr->data;
    return data[low] | (high ? (uint32_t)data[high] << 8 : 0);
}

/* What a timer of eight or sixteen bits does in each of its modes, as the data sheets number them:
 * simavr does not know all of them. */
struct waveform {
    enum { NO_PWM, FAST, PHASE_CORRECT } kind;
    /* Bits of a constant top; 0: register OCRA, or ICR. */
    uint8_t bits;
    bool top_is_icr;
};

static const struct waveform OF_8_BITS[8] = {
    [1] = {PHASE_CORRECT, 8, false},
    [3] = {FAST, 8, false},
    [5] = {PHASE_CORRECT, 0, false},
    [7] = {FAST, 0, false},
};

static const struct waveform OF_16_BITS[16] = {
    [1] = {PHASE_CORRECT, 8, false},  [2] = {PHASE_CORRECT, 9, false},
    [3] = {PHASE_CORRECT, 10, false}, [5] = {FAST, 8, false},
    [6] = {FAST, 9, false},           [7] = {FAST, 10, false},
    [8] = {PHASE_CORRECT, 0, true},   [9] = {PHASE_CORRECT, 0, false},
    [10] = {PHASE_CORRECT, 0, true},  [11] = {PHASE_CORRECT, 0, false},
    [14] = {FAST, 0, true},           [15] = {FAST, 0, false},
};

/* simavr lets a timer in a mode that it does not know overflow at each count. */
static void complete_modes(void) {
    for (avr_io_t *io = chip.avr->io_port; io; io = io->next) {
        if (strcmp(io->kind, "timer") != 0)
            continue;
        avr_timer_t *timer = (avr_timer_t *)io;
        for (unsigned i = 1; i < (timer->r_tcnth ? 16u : 8u); i++) {
            struct waveform wave = timer->r_tcnth ? OF_16_BITS[i] : OF_8_BITS[i];
            avr_timer_wgm_t *mode = &timer->wgm_op[i];
            if (mode->kind != avr_timer_wgm_none || wave.kind == NO_PWM)
                continue;
            mode->size = wave.bits;
            mode->kind = wave.bits          ? avr_timer_wgm_fc_pwm
                         : wave.kind == FAST ? avr_timer_wgm_fast_pwm
                                             : avr_timer_wgm_pwm;
            mode->top = wave.bits         ? avr_timer_wgm_reg_constant
                        : wave.top_is_icr ? avr_timer_wgm_reg_icr
                                          : avr_timer_wgm_reg_ocra;
        }
    }
}

/* Mean level of a compare output; NAN without a waveform. */
static double duty(const struct pin *pin) {
    const avr_timer_t *timer = pin->timer;
    const avr_timer_comp_t *comp = &timer->comp[pin->comp];
    if (timer->cs_div_value == 0)
        return NAN;
    uint8_t number = avr_regbit_get_array(chip.avr, (avr_regbit_t *)timer->wgm, ARRAY_SIZE(timer->wgm));
    struct waveform wave = timer->r_tcnth ? OF_16_BITS[number & 15] : OF_8_BITS[number & 7];
    uint8_t mode = avr_regbit_get(chip.avr, comp->com);
    if (mode == avr_timer_com_toggle)
        return 0.5;
    if (wave.kind == NO_PWM)
        return NAN;
    uint32_t compare = word(comp->r_ocr, comp->r_ocrh);
    uint32_t top = wave.bits         ? (1u << wave.bits) - 1
                   : wave.top_is_icr ? word(timer->r_icr, timer->r_icrh)
                                     : word(timer->comp[0].r_ocr, timer->comp[0].r_ocrh);
    double part = wave.kind == FAST ? ((double)compare + 1) / ((double)top + 1)
                  : top             ? (double)compare / top
                                    : 0;
    part = part > 1 ? 1 : part;
    return mode == avr_timer_com_set ? 1 - part : part;
}

static void on_edge(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct pin *pin = param;
    (void)irq;
    if (!is_driven(pin) || timer_drives(pin) || pin->edges++ >= EDGES_MAX)
        return;
    avr_cycle_count_t now = chip.avr->cycle;
    bool is_high = value & 1;
    if (is_high) {
        pin->rose = now;
    } else if (pin->value == 1 && pin->output >= 0) {
        double us = (double)(ns_of(now) - ns_of(pin->rose)) / 1000;
        wire_item(ITEM_OUTPUT, (uint8_t)(pin->output + 1), output_ns(now), &us, sizeof us);
    }
    tell(pin, is_high, now);
}

/* Duty or level of a pin that is driven; 0 otherwise. */
static double drive_of(const struct pin *pin) {
    if (!is_driven(pin))
        return 0;
    double value = timer_drives(pin) ? duty(pin) : NAN;
    if (!isnan(value))
        return value;
    return chip.avr->data[port_of(pin->letter)->r_port] >> pin->bit & 1;
}

static void report_bridges(void) {
    for (int i = 0; i < chip.bridge_count; i++) {
        struct bridge *bridge = &chip.bridges[i];
        double power = drive_of(&chip.pins[bridge->power]);
        double way = drive_of(&chip.pins[bridge->forward]) - drive_of(&chip.pins[bridge->backward]);
        double value = power * way;
        if (value == bridge->value)
            continue;
        bridge->value = value;
        uint64_t at = output_ns(chip.avr->cycle);
        wire_item(ITEM_OUTPUT, (uint8_t)bridge->output, at, &value, sizeof value);
    }
}

void pins_report(void) {
    report_bridges();
    for (int i = 0; i < chip.pin_count; i++) {
        struct pin *pin = &chip.pins[i];
        bool is_fast = pin->edges > EDGES_MAX;
        pin->edges = 0;
        if (pin->output < 0 || (!pin->timer && !is_fast && !isnan(pin->value)))
            continue;
        if (is_driven(pin))
            tell(pin, drive_of(pin), chip.avr->cycle);
    }
}

/* An interrupt at low level, again and again while its pin is low. simavr looks at the pin in each
 * cycle for it, also while the interrupt is off, which takes up to 20 times the work of a run. */
static void look_at_level(int number) {
    avr_t *avr = chip.avr;
    avr_int_vector_t *vector = &chip.external->eint[number].vector;
    const avr_regbit_t *sense = chip.external->eint[number].isc;
    avr_irq_t *pin = avr_io_getirq(avr, chip.external->eint[number].port_ioctl,
                                   chip.external->eint[number].port_pin);
    bool is_at_level = sense[1].reg && !avr_regbit_get(avr, sense[0]) && !avr_regbit_get(avr, sense[1]);
    if (!pin || !is_at_level)
        return;
    bool is_wanted = !pin->value && avr_regbit_get(avr, vector->enable);
    if (!is_wanted && vector->pending)
        avr_clear_interrupt(avr, vector);
    /* No flag is set by a level. */
    if (!vector->pending)
        avr_regbit_clear(avr, vector->raised);
    if (is_wanted && !vector->pending)
        avr_raise_interrupt(avr, vector);
}

static void on_level(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    (void)value;
    look_at_level((int)(intptr_t)param);
}

/* The end of an interrupt's routine; its beginning is no news. */
static void on_routine(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq;
    if (!value)
        look_at_level((int)(intptr_t)param);
}

/* Some interrupts are switched on or off, or get another sense. */
static void on_switch(avr_io_addr_t address, uint8_t old, uint8_t value, void *param) {
    (void)address;
    (void)old;
    (void)value;
    (void)param;
    for (int i = 0; i < EXTINT_COUNT; i++)
        if (chip.external->eint[i].port_ioctl)
            look_at_level(i);
}

static void forget_polling(void) {
    for (uint8_t i = 0; chip.external && i < EXTINT_COUNT; i++)
        avr_extint_set_strict_lvl_trig(chip.avr, i, 0);
}

/* Follows a register once, however many interrupts have bits in it. */
static bool is_first(avr_io_addr_t *known, size_t *count, avr_io_addr_t address) {
    for (size_t i = 0; i < *count; i++)
        if (known[i] == address)
            return false;
    known[(*count)++] = address;
    return address != 0;
}

static void attach_external(void) {
    avr_io_addr_t flags[EXTINT_COUNT + 16] = {0}, switches[3 * EXTINT_COUNT] = {0};
    size_t flag_count = 0, switch_count = 0;
    avr_extint_t *unit = chip.external;
    forget_polling();
    for (int i = 0; unit && i < EXTINT_COUNT; i++) {
        avr_int_vector_t *vector = &unit->eint[i].vector;
        if (!unit->eint[i].port_ioctl)
            continue;
        void *number = (void *)(intptr_t)i;
        avr_irq_t *running = avr_get_interrupt_irq(chip.avr, vector->vector);
        avr_irq_register_notify(unit->io.irq + i, on_level, number);
        avr_irq_register_notify(running + AVR_INT_IRQ_RUNNING, on_routine, number);
        if (is_first(flags, &flag_count, vector->raised.reg))
            flags_only(vector->raised.reg);
        clear_by_one(vector);
        const avr_io_addr_t own[] = {vector->enable.reg, unit->eint[i].isc[0].reg,
                                     unit->eint[i].isc[1].reg};
        for (size_t n = 0; n < ARRAY_SIZE(own); n++)
            if (is_first(switches, &switch_count, own[n]))
                after_write(own[n], on_switch, NULL);
    }
    for (avr_io_t *io = chip.avr->io_port; io; io = io->next) {
        avr_int_vector_t *vector = &((avr_ioport_t *)io)->pcint;
        if (strcmp(io->kind, "port") != 0 || vector->vector == 0)
            continue;
        if (flag_count < ARRAY_SIZE(flags) && is_first(flags, &flag_count, vector->raised.reg))
            flags_only(vector->raised.reg);
        clear_by_one(vector);
    }
}

/* A reset makes all pins inputs: what they drove is let go. */
void pins_reset(void) {
    for (int i = 0; i < chip.pin_count; i++) {
        struct pin *pin = &chip.pins[i];
        if (!isnan(pin->value))
            tell(pin, 0, chip.avr->cycle);
        pin->value = NAN;
    }
    report_bridges();
    forget_polling();
}

/* The sample is taken when the conversion begins. simavr scales by 1023, the converter by 1024. */
static void on_conversion(struct avr_irq_t *irq, uint32_t value, void *param) {
    avr_t *avr = chip.avr;
    avr_adc_t *adc = chip.adc;
    (void)irq;
    (void)value;
    (void)param;
    uint8_t index = avr_regbit_get_array(avr, adc->mux, ARRAY_SIZE(adc->mux));
    if (index >= 64 || adc->muxmode[index].kind != ADC_MUX_SINGLE)
        return;
    uint16_t reference = adc->ref_values[avr_regbit_get_array(avr, adc->ref, ARRAY_SIZE(adc->ref)) & 3];
    double full = reference == ADC_VREF_VCC || reference == ADC_VREF_AVCC ? chip.vcc
                  : reference == ADC_VREF_AREF                            ? chip.aref
                                                                          : reference / 1000.0;
    double code = floor(chip.volts[chip.adc_source[index] & 15] * 1024 / full);
    code = code < 0 ? 0 : code > 1023 ? 1023 : code;
    adc->adc_values[adc->muxmode[index].src & 7] = (uint16_t)ceil(code * full * 1000 / 1023);
}

/* The level of an input by its voltage, as the data sheet has it; between them it stays. */
static void drive_input(const struct pin *pin, double volts) {
    avr_ioport_t *port = port_of(pin->letter);
    uint8_t mask = (uint8_t)(1u << pin->bit);
    bool was_high = port->external.pull_value & mask;
    bool is_high = volts >= 0.6 * chip.vcc || (was_high && volts > 0.3 * chip.vcc);
    avr_ioport_external_t pull = {
        .name = pin->letter,
        .mask = port->external.pull_mask | mask,
        .value = is_high ? port->external.pull_value | mask
                         : port->external.pull_value & (uint8_t)~mask,
    };
    avr_ioctl(chip.avr, AVR_IOCTL_IOPORT_SET_EXTERNAL(pin->letter), &pull);
    if (!is_driven(pin))
        avr_raise_irq(port->io.irq + pin->bit, is_high);
}

/* Edge by edge, so that each contact's interrupt is seen. A jump of thousands is no turn. */
static void turn(struct encoder *encoder, double value) {
    static const double JUMP_MAX = 1000;
    int64_t count = (int64_t)value;
    if (!encoder->is_begun || fabs(value - (double)encoder->count) > JUMP_MAX)
        encoder->count = count - encoder->is_begun;
    while (!encoder->is_begun || encoder->count != count) {
        if (encoder->is_begun)
            encoder->count += count > encoder->count ? 1 : -1;
        encoder->is_begun = true;
        unsigned place = (unsigned)(encoder->count & 3);
        drive_input(&chip.pins[encoder->a], place == 1 || place == 2 ? chip.vcc : 0);
        drive_input(&chip.pins[encoder->b], place >= 2 ? chip.vcc : 0);
    }
}

void pins_give(int number, double value) {
    if (number < 0 || number >= chip.given_count || !(fabs(value) < 1e15))
        return;
    const struct given *given = &chip.given[number];
    if (given->encoder >= 0) {
        turn(&chip.encoders[given->encoder], value);
        return;
    }
    /* An analog pin is given millivolts, another one a level. */
    struct pin *pin = &chip.pins[given->pin];
    bool is_analog = pin->channel >= 0;
    double volts = is_analog ? value / 1000 : value != 0 ? chip.vcc : 0;
    if (is_analog)
        chip.volts[pin->channel] = volts;
    drive_input(pin, volts);
}

static void find_timer(struct pin *pin, const avr_ioport_t *port) {
    for (avr_io_t *io = chip.avr->io_port; io; io = io->next) {
        if (strcmp(io->kind, "timer") != 0)
            continue;
        avr_timer_t *timer = (avr_timer_t *)io;
        for (int comp = 0; comp < AVR_TIMER_COMP_COUNT; comp++) {
            const avr_timer_comp_t *at = &timer->comp[comp];
            bool is_it = at->com_pin.reg == port->r_port && at->com_pin.bit == pin->bit;
            if (at->com.reg && at->com_pin.reg && is_it) {
                pin->timer = timer;
                pin->comp = comp;
            }
        }
    }
}

void pins_attach(void) {
    complete_modes();
    for (int i = 0; i < chip.pin_count; i++) {
        struct pin *pin = &chip.pins[i];
        avr_ioport_t *port = port_of(pin->letter);
        if (!port)
            refuse("board.pins: pin \"%s\" is on port %c, which a %s does not have", pin->name,
                   pin->letter, chip.mcu);
        pin->value = NAN;
        find_timer(pin, port);
        if (pin->output >= 0)
            avr_irq_register_notify(port->io.irq + pin->bit, on_edge, pin);
    }
    attach_external();
    avr_adc_t *adc = chip.adc;
    if (!adc)
        return;
    clear_by_one(&adc->adc);
    /* simavr has eight places for sixteen channels. */
    for (int i = 0; i < 64; i++) {
        chip.adc_source[i] = (uint8_t)adc->muxmode[i].src;
        if (adc->muxmode[i].kind == ADC_MUX_SINGLE)
            adc->muxmode[i].src &= 7;
    }
    avr_irq_register_notify(adc->io.irq + ADC_IRQ_OUT_TRIGGER, on_conversion, NULL);
}
