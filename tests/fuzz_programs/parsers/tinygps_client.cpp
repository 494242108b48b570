/* A client of TinyGPS++. */
#include "stream.h"
#include "TinyGPS++.h"

int main(int count, char **words)
{
    TinyGPSPlus gps;
    (void)count;
    stream_open(words[1]);
    for (;;)
        gps.encode((char)stream_next());
}
