/* Reads lines of the sonar; three conditions lead to a write through a null pointer. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static unsigned sum;

static void line(const unsigned char *at, int len)
{
    int place;
    for (place = 0; place < len; place++)
        sum = sum * 31 + at[place];
    if (len < 4)
        return;
    if (at[0] == 'q') {
        sum++;
        if (at[1] == 0x17) {
            sum += 2;
            if (at[2] == 'Z')
                *(volatile int *)0 = 1;
        }
    }
}

int main(void)
{
    char path[4096];
    unsigned char held[512], got[256];
    int len = 0, count, place;
    snprintf(path, sizeof path, "%s/sonar", getenv("HILRIG_DIR"));
    int port = open(path, O_RDWR | O_NOCTTY);
    while ((count = (int)read(port, got, sizeof got)) > 0)
        for (place = 0; place < count; place++)
            if (got[place] == '\n' || len == sizeof held) {
                line(held, len);
                len = 0;
            } else
                held[len++] = got[place];
    return 0;
}
