/* A client by libserialport: prints lines, sends "ping" once. */
#include <libserialport.h>
#include <stdio.h>

int main(int count, char **words)
{
    struct sp_port *port;
    char bytes[100];
    if (count < 2 || sp_get_port_by_name(words[1], &port) != SP_OK ||
        sp_open(port, SP_MODE_READ_WRITE) != SP_OK) {
        char *why = sp_last_error_message();
        fprintf(stderr, "%s: %s\n", count < 2 ? "no port" : words[1], why ? why : "?");
        return 1;
    }
    sp_set_baudrate(port, 9600);
    sp_set_bits(port, 8);
    sp_set_parity(port, SP_PARITY_NONE);
    sp_set_stopbits(port, 1);
    sp_set_flowcontrol(port, SP_FLOWCONTROL_NONE);
    sp_blocking_write(port, "ping\r\n", 6, 1000);
    for (int turn = 0; turn < 40; turn++) {
        int len = sp_blocking_read_next(port, bytes, sizeof bytes, 1000);
        fwrite(bytes, 1, len > 0 ? len : 0, stdout);
    }
    sp_close(port);
    return 0;
}
