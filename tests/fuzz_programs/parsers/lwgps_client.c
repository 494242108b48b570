/* A client of lwgps. */
#include "stream.h"
#include "lwgps/lwgps.h"

int main(int count, char **words)
{
    static lwgps_t gps;
    (void)count;
    stream_open(words[1]);
    lwgps_init(&gps);
    for (;;) {
        char byte = (char)stream_next();
        lwgps_process(&gps, &byte, 1);
    }
}
