/* config.h - configuration of a link FMU, resources/link.txt: lines `key=value`. Lines with the key
 * `argument` give the command line of the emulator, one argument each, in this order. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef CONFIG_H
#define CONFIG_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CONFIG_SIZE = 8192, MOST_ARGUMENTS = 40, PATH_SIZE = 1024 };

typedef enum { LATE_WAIT, LATE_HOLD, LATE_STOP } Late;

typedef struct {
    char text[CONFIG_SIZE];    /* content of the file; the pointers below point into it */
    char resources[PATH_SIZE]; /* folder */
    const char *via;           /* kind of stream: emulator, tcp, unix or serial */
    const char *guid, *target; /* guid of the component; name of the processor, for messages */
    const char *host, *port;   /* tcp */
    const char *path;          /* unix: path of the socket; serial: path of the device */
    /* emulator: links with the same name here share one emulator; "": not shared */
    const char *group;
    /* command line of the emulator, in which @ means the folder of the resources, % the folder of
     * the pipes */
    const char *argument[MOST_ARGUMENTS + 1];
    size_t arguments;
    long slot, baud, retries; /* slot: index of the component on the board, -1: found by guid */
    double timeout;           /* s; longest time to wait for an answer */
    double deadline;          /* s; time after which an answer to a step is late; 0: never */
    Late late;
} Config;

static inline const char **text_of(Config *c, const char *key)
{
    struct {
        const char *key;
        const char **text;
    } known[] = {{"via", &c->via},   {"guid", &c->guid}, {"target", &c->target}, {"host", &c->host},
                 {"port", &c->port}, {"path", &c->path}, {"group", &c->group}};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strcmp(key, known[i].key) == 0) return known[i].text;
    return NULL;
}

static inline void take_setting(Config *c, const char *key, const char *value)
{
    const char **text = text_of(c, key);
    if (text) *text = value;
    else if (strcmp(key, "argument") == 0 && c->arguments < MOST_ARGUMENTS)
        c->argument[c->arguments++] = value;
    else if (strcmp(key, "slot") == 0) c->slot = atol(value);
    else if (strcmp(key, "baud") == 0) c->baud = atol(value);
    else if (strcmp(key, "retries") == 0) c->retries = atol(value);
    else if (strcmp(key, "timeout") == 0) c->timeout = strtod(value, NULL);
    else if (strcmp(key, "deadline") == 0) c->deadline = strtod(value, NULL);
    else if (strcmp(key, "late") == 0)
        c->late = strcmp(value, "hold") == 0   ? LATE_HOLD
                  : strcmp(value, "stop") == 0 ? LATE_STOP
                                               : LATE_WAIT;
}

static inline void take_lines(Config *c)
{
    for (char *line = strtok(c->text, "\n"); line; line = strtok(NULL, "\n")) {
        char *equals = strchr(line, '=');
        if (!equals) continue;
        *equals = 0;
        take_setting(c, line, equals + 1);
    }
}

static inline bool read_config(Config *c, const char *resources)
{
    char path[PATH_SIZE + 16];
    *c = (Config){.via = "",
                  .guid = "",
                  .target = "",
                  .host = "",
                  .port = "",
                  .path = "",
                  .group = "",
                  .slot = -1,
                  .baud = 115200,
                  .retries = 3,
                  .timeout = 10};
    snprintf(c->resources, sizeof c->resources, "%s", resources);
    snprintf(path, sizeof path, "%s/link.txt", resources);
    FILE *file = fopen(path, "rb");
    if (!file) return false;
    size_t count = fread(c->text, 1, sizeof c->text - 1, file);
    fclose(file);
    c->text[count] = 0;
    take_lines(c);
    return true;
}

#endif
