/* A client of minmea: each line is parsed by its kind. */
#include "stream.h"
#include "minmea.h"

int main(int count, char **words)
{
    char line[MINMEA_MAX_SENTENCE_LENGTH + 1];
    int len = 0;
    (void)count;
    stream_open(words[1]);
    for (;;) {
        int byte = stream_next();
        if (byte != '\n') {
            if (byte != '\r' && len < (int)sizeof line - 1)
                line[len++] = (char)byte;
            continue;
        }
        line[len] = 0;
        len = 0;
        union {
            struct minmea_sentence_rmc rmc;
            struct minmea_sentence_gga gga;
            struct minmea_sentence_gsa gsa;
            struct minmea_sentence_gsv gsv;
            struct minmea_sentence_vtg vtg;
        } frame;
        switch (minmea_sentence_id(line, true)) {
        case MINMEA_SENTENCE_RMC: minmea_parse_rmc(&frame.rmc, line); break;
        case MINMEA_SENTENCE_GGA: minmea_parse_gga(&frame.gga, line); break;
        case MINMEA_SENTENCE_GSA: minmea_parse_gsa(&frame.gsa, line); break;
        case MINMEA_SENTENCE_GSV: minmea_parse_gsv(&frame.gsv, line); break;
        case MINMEA_SENTENCE_VTG: minmea_parse_vtg(&frame.vtg, line); break;
        default: break;
        }
    }
}
