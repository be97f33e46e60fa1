/* binary.c - specimen of a binary port: messages that grow.
 *
 *   message   output: after step k < 100 the k + 1 bytes k, k + 1, ..., 2 k; at first a zero
 *   reply     input: connect it to message
 *   received  length of the reply that the last step has read
 *   checksum  sum of its bytes
 *
 * Under Jacobi a step reads the message of the step before. A tool that takes binary for text loses
 * the first message, whose only byte is zero. The pointer that fmi3GetBinary returns is valid until
 * the next call of a function of the instance. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "types.h"

#define TOKEN      "{5e0c1f5a-0004-4e6b-9d10-73a0b1c2d301}"
#define HAS_BINARY 1
enum { MESSAGE = 1, REPLY = 2, LONGEST = 100 };

typedef struct {
    fmi3Byte message[LONGEST], reply[LONGEST];
    size_t length, replied;
    fmi3Int32 received, checksum;
} Model;

static const Model start = {.length = 1};

static const Variable variables[] = {
    OUTPUT(3, INT32, received),
    OUTPUT(4, INT32, checksum),
};

#include "specimen.h"

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference r[], size_t n,
                         size_t size[], fmi3Binary value[], size_t values)
{
    Instance *c = instance;
    if (n != 1 || values != 1 || r[0] != MESSAGE)
        return failure(c, "fmi3GetBinary", "message alone can be read");
    size[0] = c->m.length;
    value[0] = c->m.message;
    return fmi3OK;
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference r[], size_t n,
                         const size_t size[], const fmi3Binary value[], size_t values)
{
    Instance *c = instance;
    if (n != 1 || values != 1 || r[0] != REPLY || size[0] > LONGEST)
        return failure(c, "fmi3SetBinary", "reply alone can be set, to at most 100 bytes");
    memcpy(c->m.reply, value[0], size[0]);
    c->m.replied = size[0];
    return fmi3OK;
}

static void evaluate(Instance *c) { (void)c; }

static void update(Instance *c) { (void)c; }

static double step(Instance *c, double t, double h)
{
    Model *m = &c->m;
    m->received = (fmi3Int32)m->replied;
    m->checksum = 0;
    for (size_t k = 0; k < m->replied; k++) m->checksum += m->reply[k];
    if (m->length < LONGEST) m->length += 1;
    for (size_t k = 0; k < m->length; k++) m->message[k] = (fmi3Byte)(m->length - 1 + k);
    return t + h;
}
