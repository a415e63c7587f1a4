/* Just enough JSON to read the golden vectors: objects, arrays, numbers, null, and strings without escapes.
 * The strings "nan", "inf" and "-inf" read as numbers too. Host only. */
#ifndef TEST_JSON_H
#define TEST_JSON_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct json {
    enum { JSON_NULL, JSON_NUMBER, JSON_STRING, JSON_LIST } kind; /* an object is a list whose items have keys */
    const char *key, *text;
    double number;
    size_t count;
    struct json *first, *next;
} json;

static json *json_read(char **at);

static void json_fail(const char *what, const char *where)
{
    fprintf(stderr, "%s at: %.40s\n", what, where);
    exit(2);
}

static void json_skip(char **at)
{
    while (**at == ' ' || **at == '\n' || **at == ',' || **at == ':') ++*at;
}

/* Ends the string in place. */
static char *json_string(char **at)
{
    char *start = ++*at, *end = strchr(start, '"');
    if (!end) json_fail("a string does not end", start);
    *end = 0;
    *at = end + 1;
    return start;
}

static json *json_read(char **at)
{
    json *node = calloc(1, sizeof *node);
    json_skip(at);
    if (**at == '"') {
        node->kind = JSON_STRING;
        node->text = json_string(at);
        node->number = strtod(node->text, NULL);
    } else if (**at == '[' || **at == '{') {
        const char close = **at == '[' ? ']' : '}';
        json **last = &node->first;
        node->kind = JSON_LIST;
        for (++*at, json_skip(at); **at != close; json_skip(at)) {
            const char *key = close == '}' ? json_string(at) : NULL;
            *last = json_read(at);
            (*last)->key = key;
            last = &(*last)->next;
            node->count++;
        }
        ++*at;
    } else if (strncmp(*at, "null", 4) == 0) {
        *at += 4;
    } else {
        char *end;
        node->kind = JSON_NUMBER;
        node->number = strtod(*at, &end);
        if (end == *at) json_fail("no value", *at);
        *at = end;
    }
    return node;
}

/* A whole file; the text lives on behind the nodes. */
static json *json_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    if (!file) json_fail("cannot open", path);
    char *text = calloc(1, 1u << 20), *at = text;
    if (fread(text, 1, (1u << 20) - 1, file) == 0) json_fail("cannot read", path);
    fclose(file);
    return json_read(&at);
}

static const json *json_find(const json *object, const char *key)
{
    for (const json *item = object->first; item; item = item->next)
        if (item->key && strcmp(item->key, key) == 0) return item;
    return NULL;
}

static const json *json_get(const json *object, const char *key)
{
    const json *item = json_find(object, key);
    if (!item) json_fail("no entry", key);
    return item;
}

/* All numbers of a list, nested or not, to `to`; returns how many, and only counts where `to` is null. */
static size_t json_numbers(const json *node, double *to)
{
    if (node->kind != JSON_LIST) {
        if (to) *to = node->number;
        return 1;
    }
    size_t count = 0;
    for (const json *item = node->first; item; item = item->next) count += json_numbers(item, to ? to + count : NULL);
    return count;
}

#endif
