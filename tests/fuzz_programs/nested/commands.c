/* Text lines with commands and arguments: "calibrate <axis> <value>". Tuned on. */
#include "port.h"

int main(void)
{
    char line[256];
    port_open("sonar");
    for (;;) {
        char *verb, *axis, *value;
        next_line(line, sizeof line);
        verb = strtok(line, " ");
        if (!verb)
            continue;
        if (!strcmp(verb, "calibrate")) {
            axis = strtok(0, " ");
            if (axis && !strcmp(axis, "yaw")) {
                value = strtok(0, " ");
                if (value && atoi(value) == 7777)
                    bug();
            }
        } else if (!strcmp(verb, "ping"))
            if (write(port, "pong\r\n", 6) < 0)
                return 1;
    }
}
