/* A client of cobs-c: frames that end with 0. */
#include "stream.h"
#include "cobs.h"

int main(int count, char **words)
{
    unsigned char frame[300], data[300];
    size_t len = 0;
    (void)count;
    stream_open(words[1]);
    for (;;) {
        int byte = stream_next();
        if (byte) {
            if (len < sizeof frame)
                frame[len++] = (unsigned char)byte;
            continue;
        }
        cobs_decode(data, sizeof data, frame, len);
        len = 0;
    }
}
