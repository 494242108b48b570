/* A client of marcinbor85/slip: messages with a CRC-16. */
#include "stream.h"
#include "slip.h"

static uint8_t buf[128];
static uint8_t put(uint8_t byte)
{
    (void)byte;
    return 1;
}
static void message(uint8_t *data, uint32_t size)
{
    (void)data;
    (void)size;
}

int main(int count, char **words)
{
    static const slip_descriptor_s descriptor = {
        .buf = buf, .buf_size = sizeof buf, .crc_seed = 0xFFFF,
        .recv_message = message, .write_byte = put,
    };
    slip_handler_s slip;
    (void)count;
    stream_open(words[1]);
    slip_init(&slip, &descriptor);
    for (;;)
        slip_read_byte(&slip, (uint8_t)stream_next());
}
