/* A JSON text as a table of values. Reads any bytes: what is not JSON is an error, never a crash. */
#ifndef HILRIG_JSON_H
#define HILRIG_JSON_H

#include <stdbool.h>
#include <stddef.h>

enum json_kind { JSON_NULL, JSON_BOOL, JSON_NUMBER, JSON_STRING, JSON_ARRAY, JSON_OBJECT };

struct json {
    enum json_kind kind;
    /* Bool or number. */
    double number;
    /* Without escapes, ended by 0. */
    char *string;
    /* The key, in an object. */
    char *key;
    /* Values of an array or object. */
    struct json *first;
    struct json *next;
};

/* The value of `text`; NULL, with the reason in `error`, if it is not JSON. */
struct json *json_read(const char *text, size_t len, const char **error);

/* The value of `key` in an object; NULL if there is none. */
const struct json *json_get(const struct json *object, const char *key);

/* The text of `key`; NULL if there is none, or it is not a text. */
const char *json_text(const struct json *object, const char *key);

/* The number of `key`; `otherwise` if there is none, or it is not a number. */
double json_number(const struct json *object, const char *key, double otherwise);

#endif
