/* The port of a program with a planted bug, and how its parts are called. */
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

static int port = -1;

static void port_open(const char *name)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/%s", getenv("HILRIG_DIR"), name);
    port = open(path, O_RDWR | O_NOCTTY);
    if (port < 0)
        exit(2);
}

/* The planted bug. */
static void bug(void)
{
    *(volatile int *)0 = 1;
}

/* The next byte. */
static int next(void)
{
    static unsigned char got[256];
    static int len, at;
    if (at == len) {
        len = (int)read(port, got, sizeof got);
        at = 0;
        if (len <= 0)
            exit(0);
    }
    return got[at++];
}

/* The next line without its end; its length. */
static inline int next_line(char *line, int most)
{
    int len = 0, byte;
    while ((byte = next()) != '\n')
        if (byte != '\r' && len < most - 1)
            line[len++] = (char)byte;
    line[len] = 0;
    return len;
}
