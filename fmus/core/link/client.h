/* client.h - the protocol in the simulation: sends one request at a time, repeated if necessary. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef CLIENT_H
#define CLIENT_H

#include "protocol.h"
#include "stream.h"

enum { MESSAGE_SIZE = 2400, FAILED_REQUEST = 3 /* fmi2Error */ };

typedef struct {
    Config config;
    Stream stream;
    uint8_t slot;
    uint32_t sequence;
    unsigned char request[FRAME_LIMIT], incoming[FRAME_LIMIT];
    size_t request_size, buffered, done; /* bytes; done: length of the answer last read */
    Code code;                           /* code of the last request */
    double sent;                         /* s; now_s() when the last request was sent */
    long attempts;
    bool outstanding, reversed; /* a request has no answer yet; the board is big-endian */
    uint32_t limit, variables; /* largest payload of the board; scalar variables of the component */
    bool saves;                /* the component can save its state */
    Reader data;               /* data of the last answer; valid until the next request */
    char message[MESSAGE_SIZE]; /* message of the component, or why there is no answer */
} Client;

/* connects to the board that link.txt in the folder `resources` names, and finds the component;
 * false: `message` contains the reason */
bool open_client(Client *c, const char *resources);
void close_client(Client *c);

/* writer for the payload of a new request; then call send_request() and wait_for_answer() */
Writer new_request(Client *c);
bool send_request(Client *c, Code code, const Writer *payload);
bool write_request(Client *c);       /* sends the present request again, as another attempt */
unsigned wait_for_answer(Client *c); /* returns fmi2Status; repeats up to `retries` times */
unsigned request_and_wait(Client *c, Code code,
                          const Writer *payload); /* calls the two functions above */

typedef enum { ARRIVED, TOO_LATE, BROKEN } Outcome;
Outcome wait_until(Client *c, double until, unsigned *status);

const char *peer_name(const Client *c, char *buffer, size_t size);

#endif
