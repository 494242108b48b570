/* Binary frames with a checksum, those of the register bus: a write of a magic word to a register
 * of its own. Tuned on. */
#include "port.h"

int main(void)
{
    port_open("gripper");
    for (;;) {
        uint8_t frame[140];
        unsigned sum = 0, len, at;
        if ((frame[0] = (uint8_t)next()) != 0xAB)
            continue;
        frame[1] = (uint8_t)next();
        frame[2] = (uint8_t)next();
        len = 3 + (frame[2] & 0x80 ? frame[2] & 0x7F : 0);
        for (at = 3; at < len + 2; at++)
            frame[at] = (uint8_t)next();
        for (at = 0; at < len; at++)
            sum += frame[at];
        if (frame[len] != (sum & 0xFF) || frame[len + 1] != sum >> 8)
            continue;
        if (frame[1] == 0xC3 && len == 3 + 6) {
            uint32_t magic;
            memcpy(&magic, frame + 3, 4);
            if (magic == 0xB0075EED && (frame[7] << 8 | frame[8]) > 0xFF00)
                bug();
        }
        frame[2] = 0;
        sum = 0xABu + frame[1];
        frame[3] = (uint8_t)sum;
        frame[4] = (uint8_t)(sum >> 8);
        if (write(port, frame, 5) != 5)
            return 1;
    }
}
