/* Length-prefixed records in a block of its own making on a line of text: kind, length, value.
 * Judged on. */
#include "port.h"

int main(void)
{
    port_open("sonar");
    for (;;) {
        uint8_t value[64];
        int kind = next(), len, at;
        if (kind != 0x02 && kind != 0x05 && kind != 0x77)
            continue;
        len = next();
        if (len > (int)sizeof value)
            continue;
        for (at = 0; at < len; at++)
            value[at] = (uint8_t)next();
        if (kind == 0x77 && len == 9)
            if (value[0] == 0xD1 && value[8] == 0x1E)
                if ((value[3] << 8 | value[4]) == 54321)
                    bug();
    }
}
