/* What takes the chip time and power: an EEPROM that is being written, and sleep in which clocks stand.
 *
 * ATmega328P data sheet, tables 8-1 (times of the EEPROM) and 10-1 (clocks and wake-up sources of each
 * mode of sleep); those of the ATmega640, 1284 and 32U4 are the same. */
#include <stdio.h>
#include <string.h>

#include "node.h"

enum {
    /* Erase and write, or one of them. */
    BOTH_US = 3400,
    ONE_US = 1800,
    /* The register of sleep: enable, and three bits of the mode. */
    SMCR = 0x53,
    NOISE_REDUCTION = 1,
    POWER_SAVE = 3,
    EXTENDED_STANDBY = 7,
    BOUND_MAX = 64,
};

static avr_eeprom_t *eeprom;

static avr_cycle_count_t written_to(avr_t *avr, avr_cycle_count_t when, void *param) {
    (void)when;
    (void)param;
    avr_regbit_clear(avr, eeprom->eepe);
    return 0;
}

static avr_cycle_timer_slot_t *writing(void) {
    avr_cycle_timer_slot_t *at = chip.avr->cycle_timers.timer;
    while (at && at->timer != written_to)
        at = at->next;
    return at;
}

/* simavr clears the bit at once, the chip only when the byte is written. */
static void on_control(avr_io_addr_t address, uint8_t old, uint8_t value, void *param) {
    avr_t *avr = chip.avr;
    (void)address;
    (void)param;
    bool begins = (old >> eeprom->eempe.bit & 1) && (value >> eeprom->eepe.bit & 1);
    if (begins && !writing()) {
        uint8_t mode = avr_regbit_get_array(avr, eeprom->eepm, 2);
        uint32_t us = mode == 1 || mode == 2 ? ONE_US : BOTH_US;
        avr_cycle_timer_register_usec(avr, us, written_to, eeprom);
    }
    if (writing())
        avr_regbit_set(avr, eeprom->eepe);
}

/* An interrupt of a unit whose clock stands in some modes of sleep. */
static struct bound {
    avr_int_vector_t *vector;
    char unit[NAME_MAX_LEN];
    /* Runs in power-save if it has a crystal of its own. */
    avr_timer_t *own_clock;
    bool runs_quietly;
    bool is_told;
} bounds[BOUND_MAX];
static size_t bound_count;

static void bind(avr_int_vector_t *vector, const char *unit, char number, avr_timer_t *own_clock) {
    if (vector->vector == 0 || bound_count == BOUND_MAX)
        return;
    struct bound *bound = &bounds[bound_count++];
    bound->vector = vector;
    snprintf(bound->unit, sizeof bound->unit, number ? "%s %c" : "%s", unit, number);
    bound->own_clock = own_clock;
}

static bool has_modes(void) {
    static const char *const known[] = {"atmega48", "atmega88", "atmega164", "atmega168", "atmega32",
                                        "atmega64", "atmega128", "atmega256", "atmega16u"};
    /* Older chips have the modes in another register. */
    static const char *const other[] = {"atmega32", "atmega64", "atmega128", "atmega32a",
                                        "atmega64a", "atmega128a"};
    bool is_known = false;
    for (size_t i = 0; i < ARRAY_SIZE(known); i++)
        is_known |= strncmp(chip.mcu, known[i], strlen(known[i])) == 0;
    for (size_t i = 0; i < ARRAY_SIZE(other); i++)
        is_known &= strcmp(chip.mcu, other[i]) != 0;
    return is_known;
}

void power_begin(void) {
    for (avr_io_t *io = chip.avr->io_port; io; io = io->next) {
        if (strcmp(io->kind, "eeprom") == 0) {
            eeprom = (avr_eeprom_t *)io;
            after_write(eeprom->r_eecr, on_control, NULL);
        } else if (strcmp(io->kind, "timer") == 0) {
            avr_timer_t *timer = (avr_timer_t *)io;
            avr_timer_t *own_clock = timer->as2.reg ? timer : NULL;
            bind(&timer->overflow, "timer", timer->name, own_clock);
            bind(&timer->icr, "timer", timer->name, own_clock);
            for (int i = 0; i < AVR_TIMER_COMP_COUNT; i++)
                bind(&timer->comp[i].interrupt, "timer", timer->name, own_clock);
        } else if (strcmp(io->kind, "uart") == 0) {
            avr_uart_t *uart = (avr_uart_t *)io;
            bind(&uart->rxc, "UART", uart->name, NULL);
            bind(&uart->txc, "UART", uart->name, NULL);
            bind(&uart->udrc, "UART", uart->name, NULL);
        } else if (strcmp(io->kind, "spi") == 0) {
            bind(&((avr_spi_t *)io)->spi, "SPI", 0, NULL);
        } else if (strcmp(io->kind, "adc") == 0) {
            bind(&((avr_adc_t *)io)->adc, "the converter", 0, NULL);
            bounds[bound_count - 1].runs_quietly = true;
        }
    }
}

static bool stands(const struct bound *bound, unsigned mode) {
    bool has_crystal = mode == NOISE_REDUCTION || mode == POWER_SAVE || mode == EXTENDED_STANDBY;
    if (has_crystal && bound->own_clock && avr_regbit_get(chip.avr, bound->own_clock->as2))
        return false;
    return !(mode == NOISE_REDUCTION && bound->runs_quietly);
}

/* simavr wakes the chip by any interrupt. Those of units without a clock do not come. */
void sleep_on(void) {
    static const char *const modes[] = {"idle", "ADC noise reduction", "power-down", "power-save",
                                        "mode 4", "mode 5", "standby", "extended standby"};
    avr_t *avr = chip.avr;
    unsigned mode = has_modes() ? avr->data[SMCR] >> 1 & 7 : 0;
    if (mode == 0)
        return;
    for (size_t i = 0; i < bound_count; i++) {
        struct bound *bound = &bounds[i];
        if (!bound->vector->pending || !stands(bound, mode))
            continue;
        avr_clear_interrupt(avr, bound->vector);
        if (!bound->is_told)
            note(ITEM_FAULT_OR_NOTE, "sleeps-on",
                 "%s cannot wake the chip from %s: its clock stands then, and the chip sleeps on",
                 bound->unit, modes[mode]);
        bound->is_told = true;
    }
    for (int i = 0; i < avr->interrupts.vector_count; i++)
        if (avr->interrupts.vector[i]->pending)
            return;
    avr->state = cpu_Sleeping;
}
