/* client.h - the simulation's end of the protocol: one request at a time, asked again if need be.
 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef CLIENT_H
#define CLIENT_H

#include "protocol.h"
#include "stream.h"

enum { SAID_SIZE = 2400, FAILED_REQUEST = 3 /* fmi2Error */ };

typedef struct {
    Config config;
    Stream stream;
    uint8_t slot;
    uint32_t sequence;
    unsigned char request[FRAME_LIMIT], incoming[FRAME_LIMIT];
    size_t request_size, held, done; /* bytes; done: of the answer that has been read */
    Code code;                       /* of the last request */
    double sent;                     /* now_s() */
    long tries;
    bool outstanding, reversed; /* still to be answered; by a peer of the other byte order */
    uint32_t limit, variables;  /* of the board: payload, scalar variables of the component */
    bool saves;                 /* the component can save its state */
    Reader data;                /* of the last answer; lasts until the next request */
    char said[SAID_SIZE];       /* by the component, or why there is no answer */
} Client;

/* connects and finds the component; false and `said` */
bool open_client(Client *c, const char *resources);
void close_client(Client *c);

/* a request: what is put into the writer, then send, then conclude */
Writer new_request(Client *c);
bool send_request(Client *c, Code code, const Writer *payload);
unsigned conclude(Client *c); /* fmi2Status; asks again as often as configured */
unsigned ask(Client *c, Code code, const Writer *payload); /* both */

typedef enum { ARRIVED, TOO_LATE, BROKEN } Outcome;
Outcome await(Client *c, double until, unsigned *status);

const char *peer_name(const Client *c, char *buffer, size_t size);

#endif
