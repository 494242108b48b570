#include "json.h"

#include <stdlib.h>
#include <string.h>

/* A text of the rig is three levels deep. */
static const int DEPTH_MAX = 32;

struct reader {
    const char *at;
    const char *end;
    const char *error;
};

static struct json *value(struct reader *reader, int depth);

static void skip_space(struct reader *reader) {
    while (reader->at < reader->end && strchr(" \t\r\n", *reader->at) && *reader->at)
        reader->at++;
}

static bool take(struct reader *reader, char wanted) {
    skip_space(reader);
    if (reader->at == reader->end || *reader->at != wanted)
        return false;
    reader->at++;
    return true;
}

static struct json *fail(struct reader *reader, const char *error) {
    if (!reader->error)
        reader->error = error;
    return NULL;
}

static int hex_digit(char digit) {
    const char *digits = "0123456789abcdef";
    const char *found = strchr(digits, digit | 0x20);
    if (digit >= '0' && digit <= '9')
        return digit - '0';
    return found && digit != '\0' && found - digits > 9 ? (int)(found - digits) : -1;
}

static char *put_utf8(char *to, unsigned code) {
    if (code < 0x80) {
        *to++ = (char)code;
    } else if (code < 0x800) {
        *to++ = (char)(0xC0 | code >> 6);
        *to++ = (char)(0x80 | (code & 0x3F));
    } else {
        *to++ = (char)(0xE0 | code >> 12);
        *to++ = (char)(0x80 | (code >> 6 & 0x3F));
        *to++ = (char)(0x80 | (code & 0x3F));
    }
    return to;
}

/* The text behind a quotation mark. An escape is never shorter than what it stands for. */
static char *text(struct reader *reader) {
    char *start = malloc((size_t)(reader->end - reader->at) + 1);
    char *to = start;
    if (!start)
        return (void)fail(reader, "no memory"), NULL;
    while (reader->at < reader->end && *reader->at != '"') {
        char next = *reader->at++;
        if (next != '\\') {
            *to++ = next;
            continue;
        }
        char escape = reader->at < reader->end ? *reader->at++ : '\0';
        const char *names = "\"\\/bfnrt", *means = "\"\\/\b\f\n\r\t";
        const char *name = escape ? strchr(names, escape) : NULL;
        if (name) {
            *to++ = means[name - names];
        } else if (escape == 'u' && reader->end - reader->at >= 4) {
            unsigned code = 0;
            for (int i = 0; i < 4; i++) {
                int digit = hex_digit(*reader->at++);
                if (digit < 0)
                    return free(start), (void)fail(reader, "an escape \\u is not hexadecimal"), NULL;
                code = code << 4 | (unsigned)digit;
            }
            to = put_utf8(to, code ? code : '?');
        } else {
            return free(start), (void)fail(reader, "an unknown escape in a text"), NULL;
        }
    }
    if (reader->at == reader->end)
        return free(start), (void)fail(reader, "a text does not end"), NULL;
    reader->at++;
    *to = '\0';
    return start;
}

static struct json *make(struct reader *reader, enum json_kind kind) {
    struct json *made = calloc(1, sizeof *made);
    if (!made)
        return fail(reader, "no memory");
    made->kind = kind;
    return made;
}

static struct json *list(struct reader *reader, bool is_object, int depth) {
    struct json *made = make(reader, is_object ? JSON_OBJECT : JSON_ARRAY);
    char close = is_object ? '}' : ']';
    if (!made || take(reader, close))
        return made;
    struct json **last = &made->first;
    do {
        char *key = NULL;
        if (is_object) {
            if (!take(reader, '"'))
                return fail(reader, "a key in quotation marks is missing");
            if (!(key = text(reader)))
                return NULL;
            if (!take(reader, ':'))
                return fail(reader, "a colon behind a key is missing");
        }
        struct json *item = value(reader, depth + 1);
        if (!item)
            return NULL;
        item->key = key;
        *last = item;
        last = &item->next;
    } while (take(reader, ','));
    return take(reader, close) ? made : fail(reader, "a list or object does not end");
}

static bool word(struct reader *reader, const char *wanted) {
    size_t len = strlen(wanted);
    if ((size_t)(reader->end - reader->at) < len || memcmp(reader->at, wanted, len) != 0)
        return false;
    reader->at += len;
    return true;
}

static struct json *number(struct reader *reader) {
    char digits[64];
    size_t len = 0;
    while (reader->at < reader->end && *reader->at && strchr("+-.0123456789eE", *reader->at)) {
        if (len == sizeof digits - 1)
            return fail(reader, "a number is too long");
        digits[len++] = *reader->at++;
    }
    digits[len] = '\0';
    char *end = NULL;
    struct json *made = make(reader, JSON_NUMBER);
    if (!made)
        return NULL;
    made->number = strtod(digits, &end);
    return len > 0 && *end == '\0' ? made : fail(reader, "a value is neither text nor number");
}

static struct json *value(struct reader *reader, int depth) {
    if (depth > DEPTH_MAX)
        return fail(reader, "lists are nested too deeply");
    if (take(reader, '{'))
        return list(reader, true, depth);
    if (take(reader, '['))
        return list(reader, false, depth);
    if (take(reader, '"')) {
        struct json *made = make(reader, JSON_STRING);
        return made && (made->string = text(reader)) ? made : NULL;
    }
    bool is_true = word(reader, "true");
    if (is_true || word(reader, "false")) {
        struct json *made = make(reader, JSON_BOOL);
        if (made)
            made->number = is_true;
        return made;
    }
    return word(reader, "null") ? make(reader, JSON_NULL) : number(reader);
}

struct json *json_read(const char *given, size_t len, const char **error) {
    struct reader reader = {given, given + len, NULL};
    struct json *read = value(&reader, 0);
    skip_space(&reader);
    if (read && reader.at != reader.end)
        read = fail(&reader, "something follows the value");
    *error = reader.error;
    return read;
}

const struct json *json_get(const struct json *object, const char *key) {
    const struct json *at = object && object->kind == JSON_OBJECT ? object->first : NULL;
    while (at && strcmp(at->key, key) != 0)
        at = at->next;
    return at;
}

const char *json_text(const struct json *object, const char *key) {
    const struct json *found = json_get(object, key);
    return found && found->kind == JSON_STRING ? found->string : NULL;
}

double json_number(const struct json *object, const char *key, double otherwise) {
    const struct json *found = json_get(object, key);
    return found && found->kind == JSON_NUMBER ? found->number : otherwise;
}
