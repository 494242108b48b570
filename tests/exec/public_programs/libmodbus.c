/* A client by libmodbus: reads two registers twenty times. */
#include <modbus.h>
#include <stdio.h>
#include <unistd.h>

int main(int count, char **words)
{
    modbus_t *meter = count > 1 ? modbus_new_rtu(words[1], 9600, 'N', 8, 1) : NULL;
    if (!meter || modbus_set_slave(meter, 1) || modbus_connect(meter)) return 1;
    for (int turn = 1; turn <= 20; turn++) {
        uint16_t found[2] = {0};
        if (modbus_read_registers(meter, 0, 2, found) != 2) return 2;
        printf("%d: %u %u\n", turn, found[0], found[1]);
        fflush(stdout);
        usleep(200000);
    }
    modbus_close(meter);
    return 0;
}
