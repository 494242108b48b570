/* A client of cJSON: one document a line. */
#include "stream.h"
#include "cJSON.h"

int main(int count, char **words)
{
    static char line[2048];
    int len = 0;
    (void)count;
    stream_open(words[1]);
    for (;;) {
        int byte = stream_next();
        if (byte != '\n') {
            if (len < (int)sizeof line - 1)
                line[len++] = (char)byte;
            continue;
        }
        line[len] = 0;
        len = 0;
        cJSON_Delete(cJSON_Parse(line));
    }
}
