// Ranges of numbers in a line of "key=value" pairs, in C++ with its strings and maps. Judged on.
#include <map>
#include <string>

#include "port.h"

static std::map<std::string, long> parsed(const std::string &line)
{
    std::map<std::string, long> values;
    for (size_t at = 0; at < line.size();) {
        size_t end = line.find(';', at), is;
        if (end == std::string::npos)
            end = line.size();
        is = line.find('=', at);
        if (is != std::string::npos && is < end)
            values[line.substr(at, is - at)] = strtol(line.c_str() + is + 1, nullptr, 10);
        at = end + 1;
    }
    return values;
}

int main()
{
    char line[256];
    port_open("sonar");
    for (;;) {
        next_line(line, sizeof line);
        std::map<std::string, long> values = parsed(line);
        if (values.count("speed") && values["speed"] > 12000 && values["speed"] < 12100)
            if (values.count("heading") && values["heading"] == -270)
                bug();
    }
}
