/* The two-wire bus and SPI. The chips are the rig's; the microcontroller is their master.
 *
 *   begin   | 02 | 2 | address | most |     answer | 02 | status | length | bytes |
 *   end     | 03 | length | address | data written |
 *   end     | 04 | 1 | bytes that the master took |
 *
 * A transaction begins with a question to the chip: does it acknowledge, and what would it say? The
 * clock is held until the answer is there, as a chip may; silence is no acknowledge. */
#include <string.h>

#include "node.h"

enum { BEGIN = 0x02, END_WRITE = 0x03, END_READ = 0x04, READ_MOST = 64 };

/* Longer than an answer takes: a message that is lost is not acknowledged. An answer that comes up
 * to so much later belongs to the question before. */
static const uint64_t ANSWER_NS_MAX = 2000000;

/* simavr's states behind an address. */
enum { WRITE_ACK = 0x18, WRITE_NACK = 0x20, READ_ACK = 0x40, READ_NACK = 0x48 };

static uint64_t at_once(void) {
    uint64_t at = ns_of(chip.avr->cycle);
    return at > chip.now_ns ? at : chip.now_ns;
}

/* Nine bits; SCL has 16 + 2 TWBR 4^TWPS cycles. The bit rate is the register before the status. */
static avr_cycle_count_t byte_cycles(const avr_twi_t *io) {
    avr_t *avr = chip.avr;
    unsigned prescaler = 1u << 2 * avr_regbit_get(avr, io->twps);
    return 9 * (avr_cycle_count_t)(16 + 2u * avr->data[io->r_twbr] * prescaler);
}

static void end_transaction(void) {
    struct twi *twi = &chip.twi;
    if (!twi->is_open)
        return;
    twi->is_open = false;
    uint8_t message[3 + sizeof twi->written];
    size_t len = 0;
    if (twi->address & 1) {
        message[0] = END_READ;
        message[1] = 1;
        message[2] = (uint8_t)twi->taken;
        len = 3;
    } else {
        message[0] = END_WRITE;
        message[1] = (uint8_t)(twi->written_len + 1);
        message[2] = twi->address;
        memcpy(message + 3, twi->written, twi->written_len);
        len = 3 + twi->written_len;
    }
    wire_item(ITEM_BYTES, (uint8_t)twi->port, at_once(), message, len);
}

/* A question that is given up may still be answered. If its time began with the answer to an
 * earlier one, its own may have been that. */
static void give_up(struct chip_on_bus *at) {
    if (!at->is_asked)
        return;
    at->is_asked = false;
    at->is_late = !at->had_late;
    at->late_until = chip.avr->cycle + cycles_of(ANSWER_NS_MAX);
}

/* The rig's messages are shorter than some transactions: what does not fit is no silent loss. */
static void exceed(const char *what, unsigned most) {
    struct twi *twi = &chip.twi;
    if (!twi->is_told)
        note(ITEM_GIVEN_OR_VIOLATION, "i2c-limit",
             "the program %s more than %u bytes in one transaction of I2C with address 0x%02x, the "
             "simulated bus carries %u; use shorter ones",
             what, most, twi->address >> 1, most);
    twi->is_told = true;
}

static void begin_transaction(uint8_t address) {
    struct twi *twi = &chip.twi;
    end_transaction();
    twi->address = address;
    twi->written_len = twi->read_len = twi->taken = 0;
    twi->is_told = false;
    /* The line of a bus without chips is not pulled down. */
    uint8_t message[4] = {BEGIN, 2, address, address & 1 ? READ_MOST : 0};
    for (int i = 0; i < twi->chip_count; i++) {
        struct chip_on_bus *at = &twi->chips[i];
        give_up(at);
        at->is_asked = true;
        at->had_late = false;
        at->answer_len = 0;
        wire_item(ITEM_BYTES, (uint8_t)at->port, at_once(), message, sizeof message);
    }
    twi->held = twi->chip_count > 0;
    twi->begun = chip.avr->cycle;
    twi->deadline = chip.avr->cycle + cycles_of(ANSWER_NS_MAX + 2 * chip.slice_ns);
}

static void on_twi(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct twi *twi = &chip.twi;
    avr_twi_msg_irq_t message;
    (void)irq;
    (void)param;
    message.u.v = value;
    uint8_t what = message.u.twi.msg, address = message.u.twi.addr;
    avr_irq_t *answer = twi->io->io.irq + TWI_IRQ_INPUT;
    twi->touched = true;
    /* The step ends behind this instruction, so that its timer can be set right. */
    chip.avr->run_cycle_limit = 1;
    if (what & TWI_COND_STOP)
        end_transaction();
    if (what & TWI_COND_START)
        begin_transaction(address);
    if ((what & TWI_COND_WRITE) && twi->is_open) {
        if (twi->written_len < sizeof twi->written)
            twi->written[twi->written_len++] = message.u.twi.data;
        else
            exceed("writes", sizeof twi->written);
        avr_raise_irq(answer, avr_twi_irq_msg(TWI_COND_ACK, address, 1));
    }
    if (what & TWI_COND_READ) {
        bool is_there = twi->is_open && twi->taken < twi->read_len;
        uint8_t byte = is_there ? twi->read[twi->taken] : 0xFF;
        if (twi->is_open && twi->taken == READ_MOST)
            exceed("reads", READ_MOST);
        twi->taken += twi->taken < 255;
        avr_raise_irq(answer, avr_twi_irq_msg(TWI_COND_READ, address, byte));
    }
}

static void conclude(bool is_there) {
    struct twi *twi = &chip.twi;
    avr_t *avr = chip.avr;
    avr_twi_t *io = twi->io;
    twi->held = false;
    twi->is_open = is_there;
    /* The program has switched the bus off meanwhile. */
    if (!twi->resume || !avr_regbit_get(avr, io->twen) || !(io->state & TWI_COND_ADDR))
        return;
    bool reads = twi->address & 1;
    io->next_twstate = reads ? (is_there ? READ_ACK : READ_NACK) : is_there ? WRITE_ACK : WRITE_NACK;
    io->state = (uint8_t)(is_there ? io->state | TWI_COND_ACK : io->state & ~TWI_COND_ACK);
    avr_cycle_count_t end = twi->begun + byte_cycles(io);
    avr_cycle_timer_register(avr, end > avr->cycle ? end - avr->cycle : 1, twi->resume, io);
}

void twi_settle(void) {
    struct twi *twi = &chip.twi;
    avr_t *avr = chip.avr;
    if (twi->touched) {
        twi->touched = false;
        avr_cycle_timer_slot_t *timer = timer_of(twi->io);
        if (timer) {
            avr_cycle_timer_t resume = timer->timer;
            twi->resume = resume;
            if (twi->held)
                avr_cycle_timer_cancel(avr, resume, twi->io);
            else
                avr_cycle_timer_register(avr, byte_cycles(twi->io), resume, twi->io);
        }
    }
    if (twi->held && avr->cycle >= twi->deadline) {
        for (int i = 0; i < twi->chip_count; i++)
            give_up(&twi->chips[i]);
        conclude(false);
    }
}

void twi_receive(int port, const uint8_t *bytes, size_t len) {
    struct twi *twi = &chip.twi;
    struct chip_on_bus *from = NULL;
    bool others_asked = false;
    for (int i = 0; i < twi->chip_count; i++) {
        if (twi->chips[i].port == port)
            from = &twi->chips[i];
        else
            others_asked = others_asked || twi->chips[i].is_asked;
    }
    if (from && from->is_late) {
        from->is_late = false;
        from->had_late = chip.avr->cycle < from->late_until;
        if (from->had_late)
            return;
    }
    if (!from || !from->is_asked)
        return;
    if (!twi->held) {
        from->is_asked = false;
        return;
    }
    size_t room = sizeof from->answer - from->answer_len;
    size_t taken = len < room ? len : room;
    memcpy(from->answer + from->answer_len, bytes, taken);
    from->answer_len += (unsigned)taken;
    if (from->answer_len < 3 || from->answer_len < 3u + from->answer[2])
        return;
    from->is_asked = false;
    /* An answer that damage has made unreadable counts as none. */
    bool is_there = from->answer[0] == BEGIN && from->answer[1] == 0;
    if (!is_there && others_asked)
        return;
    if (is_there) {
        twi->port = port;
        twi->read_len = from->answer[2];
        memcpy(twi->read, from->answer + 3, twi->read_len);
    }
    conclude(is_there);
}

void twi_reset(void) {
    struct twi *twi = &chip.twi;
    if (!twi->io)
        return;
    /* The bus is let go in the midst of a transaction. */
    end_transaction();
    twi->held = twi->touched = false;
    /* What the program before asked is no question of this one. */
    for (int i = 0; i < twi->chip_count; i++)
        twi->chips[i].is_asked = twi->chips[i].is_late = twi->chips[i].had_late = false;
}

void twi_attach(void) {
    avr_irq_register_notify(chip.twi.io->io.irq + TWI_IRQ_OUTPUT, on_twi, NULL);
    clear_by_one(&chip.twi.io->twi);
}

/* simavr takes 100 us for each byte: eight bits of fosc / 4, 16, 64, 128, half with SPI2X. */
static void on_spi_data(struct avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    avr_spi_t *io = chip.spi.io;
    (void)address;
    (void)value;
    (void)param;
    static const uint8_t dividers[4] = {4, 16, 64, 128};
    unsigned rate = avr_regbit_get(avr, io->spr[0]) | (unsigned)avr_regbit_get(avr, io->spr[1]) << 1;
    unsigned divider = dividers[rate & 3] >> avr_regbit_get(avr, io->spr[2]);
    avr_cycle_timer_slot_t *timer = timer_of(io);
    if (timer)
        avr_cycle_timer_register(avr, 8 * divider, timer->timer, io);
}

/* A byte has been clocked out; what came in meanwhile is FF if no chip drives the line. */
static void on_spi(struct avr_irq_t *irq, uint32_t value, void *param) {
    struct spi *spi = &chip.spi;
    uint8_t byte = (uint8_t)value;
    (void)irq;
    (void)param;
    if (!avr_regbit_get(chip.avr, spi->io->mstr))
        return;
    if (spi->port < 0) {
        spi->io->input_data_register = 0xFF;
        return;
    }
    avr_clear_interrupt(chip.avr, &spi->io->spi);
    avr_regbit_clear(chip.avr, spi->io->spi.raised);
    wire_item(ITEM_BYTES, (uint8_t)spi->port, at_once(), &byte, 1);
    spi->held = true;
    spi->deadline = chip.avr->cycle + cycles_of(ANSWER_NS_MAX);
}

void spi_receive(const uint8_t *bytes, size_t len) {
    struct spi *spi = &chip.spi;
    if (!spi->held || len == 0)
        return;
    spi->held = false;
    avr_raise_irq(spi->io->io.irq + SPI_IRQ_INPUT, bytes[0]);
}

void spi_settle(void) {
    struct spi *spi = &chip.spi;
    static const uint8_t idle = 0xFF;
    if (spi->held && chip.avr->cycle >= spi->deadline)
        spi_receive(&idle, 1);
}

void spi_attach(void) {
    avr_spi_t *io = chip.spi.io;
    avr_irq_register_notify(io->io.irq + SPI_IRQ_OUTPUT, on_spi, NULL);
    avr_register_io_write(chip.avr, io->r_spdr, on_spi_data, NULL);
}

avr_cycle_count_t bus_deadline(void) {
    avr_cycle_count_t deadline = NEVER;
    if (chip.twi.held)
        deadline = chip.twi.deadline;
    if (chip.spi.held && chip.spi.deadline < deadline)
        deadline = chip.spi.deadline;
    return deadline;
}
