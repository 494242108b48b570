/* A state machine over several lines; anything else goes back to the begin. Tuned on. */
#include "port.h"

int main(void)
{
    char line[128];
    enum { OFF, OPEN, ARMED, LOADED } state = OFF;
    port_open("sonar");
    for (;;) {
        next_line(line, sizeof line);
        switch (state) {
        case OFF:
            state = !strcmp(line, "open") ? OPEN : OFF;
            break;
        case OPEN:
            state = !strcmp(line, "arm=1") ? ARMED : OFF;
            break;
        case ARMED:
            state = !strncmp(line, "load ", 5) && atoi(line + 5) == 42 ? LOADED : OFF;
            break;
        case LOADED:
            if (!strcmp(line, "go"))
                bug();
            state = OFF;
        }
    }
}
