/* Bytes of a port, or of a file: the same program for both ways of fuzzing. */
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

static int stream = -1;

static void stream_open(const char *path)
{
    struct termios raw;
    stream = open(path, O_RDWR | O_NOCTTY);
    if (stream < 0)
        stream = open(path, O_RDONLY);
    if (stream < 0)
        exit(2);
    if (tcgetattr(stream, &raw) == 0) {
        cfmakeraw(&raw);
        cfsetspeed(&raw, B115200);
        tcsetattr(stream, TCSANOW, &raw);
    }
}

/* The next byte; the program ends with the stream. */
static int stream_next(void)
{
    static unsigned char got[256];
    static int len, at;
    if (at == len) {
        len = (int)read(stream, got, sizeof got);
        at = 0;
        if (len <= 0)
            exit(0);
    }
    return got[at++];
}
