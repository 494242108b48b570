/* A server on libmodbus: registers behind Modbus RTU. A file is played through a socket. */
#include <errno.h>
#include <sys/socket.h>

#include "stream.h"
#include "modbus.h"

int main(int count, char **words)
{
    modbus_t *bus = modbus_new_rtu("/dev/null", 115200, 'N', 8, 1);
    modbus_mapping_t *map = modbus_mapping_new(64, 64, 64, 64);
    uint8_t request[MODBUS_RTU_MAX_ADU_LENGTH];
    (void)count;
    stream_open(words[1]);
    if (!isatty(stream)) {
        char bytes[4096];
        int ends[2], len = (int)read(stream, bytes, sizeof bytes);
        if (socketpair(AF_UNIX, SOCK_STREAM, 0, ends) || write(ends[0], bytes, len) != len)
            return 2;
        shutdown(ends[0], SHUT_WR);
        stream = ends[1];
    }
    modbus_set_slave(bus, 1);
    modbus_set_socket(bus, stream);
    for (;;) {
        int len = modbus_receive(bus, request);
        if (len > 0)
            modbus_reply(bus, request, len, map);
        else if (len < 0 && errno != EMBBADCRC && errno != ETIMEDOUT && errno != EMBBADDATA)
            return 0;
    }
}
