/* A server on nanoMODBUS: registers and coils behind Modbus RTU. */
#include <poll.h>

#include "stream.h"
#include "nanomodbus.h"

static uint16_t registers[64];

static int32_t get(uint8_t *buf, uint16_t count, int32_t timeout_ms, void *arg)
{
    uint16_t got = 0;
    (void)arg;
    while (got < count) {
        struct pollfd port = { .fd = stream, .events = POLLIN };
        if (poll(&port, 1, timeout_ms) <= 0)
            break;
        int one = (int)read(stream, buf + got, count - got);
        if (one <= 0)
            exit(0);
        got += one;
    }
    return got;
}

static int32_t put(const uint8_t *buf, uint16_t count, int32_t timeout_ms, void *arg)
{
    (void)timeout_ms;
    (void)arg;
    return isatty(stream) ? (int32_t)write(stream, buf, count) : count;
}

static nmbs_error get_registers(uint16_t at, uint16_t count, uint16_t *out, uint8_t unit, void *arg)
{
    (void)unit;
    (void)arg;
    if (at + count > 64)
        return NMBS_EXCEPTION_ILLEGAL_DATA_ADDRESS;
    memcpy(out, registers + at, 2 * count);
    return NMBS_ERROR_NONE;
}

static nmbs_error put_registers(uint16_t at, uint16_t count, const uint16_t *in, uint8_t unit, void *arg)
{
    (void)unit;
    (void)arg;
    if (at + count > 64)
        return NMBS_EXCEPTION_ILLEGAL_DATA_ADDRESS;
    memcpy(registers + at, in, 2 * count);
    return NMBS_ERROR_NONE;
}

static nmbs_error put_coil(uint16_t at, bool value, uint8_t unit, void *arg)
{
    (void)value;
    (void)unit;
    (void)arg;
    return at < 64 ? NMBS_ERROR_NONE : NMBS_EXCEPTION_ILLEGAL_DATA_ADDRESS;
}

int main(int count, char **words)
{
    nmbs_platform_conf platform;
    nmbs_callbacks callbacks;
    nmbs_t bus;
    (void)count;
    stream_open(words[1]);
    nmbs_platform_conf_create(&platform);
    platform.transport = NMBS_TRANSPORT_RTU;
    platform.read = get;
    platform.write = put;
    nmbs_callbacks_create(&callbacks);
    callbacks.read_holding_registers = get_registers;
    callbacks.write_multiple_registers = put_registers;
    callbacks.write_single_coil = put_coil;
    if (nmbs_server_create(&bus, 1, &platform, &callbacks) != NMBS_ERROR_NONE)
        return 2;
    nmbs_set_read_timeout(&bus, 1000);
    nmbs_set_byte_timeout(&bus, 100);
    for (;;)
        nmbs_server_poll(&bus);
}
