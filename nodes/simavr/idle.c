/* A program that waits in a loop for an interrupt or an input does the same again and again. When a
 * turn of the loop has left everything as it was, the turns up to the next event are left out.
 *
 * All that a turn may do is found out instruction by instruction: it may read, and write to the RAM;
 * it may not write to a unit. Registers, flags and memory are compared byte by byte. */
#include <string.h>

#include "node.h"

#include <sim_core.h>

enum {
    /* Longest turn, in instructions. */
    TURN_MAX = 600,
    /* Below this distance to the next event a turn is not worth the look. */
    WORTH_CYCLES = 1500,
    /* Fruitless looks make the next ones rarer. */
    PAUSE_MAX = 64,
};

static uint8_t memory[1 << 17];
static unsigned pause, waited;

static uint16_t word_at(avr_flashaddr_t at) {
    return (uint16_t)(chip.avr->flash[at] | chip.avr->flash[at + 1] << 8);
}

/* Where the RAM begins, behind registers and units. */
static uint16_t ram_start(void) { return (uint16_t)(chip.avr->ioend + 1); }

static uint16_t pointer(unsigned low) {
    return (uint16_t)(chip.avr->data[low] | chip.avr->data[low + 1] << 8);
}

/* Whether an instruction writes to no unit. */
static bool is_harmless(uint16_t op, avr_flashaddr_t at) {
    enum { X = 26, Y = 28, Z = 30 };
    uint16_t q = (uint16_t)((op & 7) | (op >> 7 & 0x18) | (op >> 8 & 0x20));
    /* OUT: SREG and the stack pointer are no units. */
    if ((op & 0xF800) == 0xB800) {
        unsigned address = (op & 0xF) | (op >> 5 & 0x30);
        return address >= 0x3D;
    }
    /* SBI, CBI. */
    if ((op & 0xFD00) == 0x9800)
        return false;
    /* STD with a displacement. */
    if ((op & 0xD200) == 0x8200)
        return pointer(op & 8 ? Y : Z) + q >= ram_start();
    if ((op & 0xFE00) == 0x9200) {
        switch (op & 0xF) {
        case 0x0: return word_at(at + 2) >= ram_start();
        case 0x1: return pointer(Z) >= ram_start();
        case 0x2: return pointer(Z) > ram_start();
        case 0x9: return pointer(Y) >= ram_start();
        case 0xA: return pointer(Y) > ram_start();
        case 0xC:
        case 0xD: return pointer(X) >= ram_start();
        case 0xE: return pointer(X) > ram_start();
        case 0xF: return true;
        default: return false;
        }
    }
    /* SLEEP, BREAK, SPM. */
    return op != 0x9588 && op != 0x9598 && op != 0x95E8 && op != 0x95F8;
}

/* The watchdog that a turn has fed is fed in the last of the turns left out. */
static void feed_watchdog(avr_cycle_count_t by) {
    avr_t *avr = chip.avr;
    for (avr_io_t *io = avr->io_port; io; io = io->next) {
        avr_cycle_timer_slot_t *timer = strcmp(io->kind, "watchdog") == 0 ? timer_of(io) : NULL;
        if (timer)
            avr_cycle_timer_register(avr, timer->when + by - avr->cycle, timer->timer, io);
    }
}

static bool leave_out(avr_cycle_count_t end) {
    avr_t *avr = chip.avr;
    size_t size = (size_t)avr->ramend + 1;
    avr_flashaddr_t start = avr->pc;
    avr_cycle_count_t began = avr->cycle;
    uint8_t flags[8];
    bool feeds = false;
    memcpy(memory, avr->data, size);
    memcpy(flags, avr->sreg, sizeof flags);
    for (int i = 0; i < TURN_MAX; i++) {
        uint16_t op = word_at(avr->pc);
        if (!is_harmless(op, avr->pc))
            return false;
        /* WDR. */
        feeds = feeds || op == 0x95A8;
        avr->run_cycle_limit = avr->run_cycle_count = 1;
        avr_flashaddr_t next = avr_run_one(avr);
        avr->pc = next;
        if (avr->state != cpu_Running)
            return false;
        if (avr->interrupt_state)
            avr_service_interrupts(avr);
        if (avr->pc != next || avr->cycle >= end)
            return false;
        bool is_back = next == start && !avr->interrupt_state;
        if (!is_back || memcmp(flags, avr->sreg, sizeof flags) != 0 ||
            memcmp(memory, avr->data, size) != 0)
            continue;
        avr_cycle_count_t turn = avr->cycle - began;
        avr_cycle_count_t turns = (end - avr->cycle - 1) / turn;
        if (feeds)
            feed_watchdog(turns * turn);
        avr->cycle += turns * turn;
        return true;
    }
    return false;
}

void idle_look(avr_cycle_count_t end) {
    avr_t *avr = chip.avr;
    if (!chip.leaves_out || avr->gdb || avr->state != cpu_Running || avr->interrupt_state ||
        avr->pc + 2 >= avr->codeend)
        return;
    const avr_cycle_timer_slot_t *first = avr->cycle_timers.timer;
    if (first && first->when < end)
        end = first->when;
    if (end < avr->cycle + WORTH_CYCLES || waited++ < pause)
        return;
    waited = 0;
    if (leave_out(end))
        pause = 0;
    else
        pause = pause == 0 ? 1 : pause < PAUSE_MAX ? 2 * pause : PAUSE_MAX;
}
