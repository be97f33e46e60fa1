/* protocol.h - frames between a simulation and a board: docs/protocol.md in C, for both ends.
 *
 *   magic "SLNK" | version | code | component | status | sequence | length | CRC   header, 20 bytes
 *   payload, `length` bytes | CRC over header and payload
 *
 * All numbers are little-endian in frames on every machine. Freestanding C99. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifndef PAYLOAD_LIMIT       /* bytes, a multiple of 8 */
#define PAYLOAD_LIMIT 65536 /* for a small board compile with -DPAYLOAD_LIMIT=8192 */
#endif

enum {
    PROTOCOL_VERSION = 1,
    HEADER_SIZE = 20,
    CRC_SIZE = 4,
    FRAME_LIMIT = HEADER_SIZE + PAYLOAD_LIMIT + CRC_SIZE,
    ANSWER = 0x80 /* bit of the code that is set in answers */
};

typedef enum {
    DESCRIBE = 1, /* interface of the component; begins a session */
    RESET,        /* return to the state after instantiation */
    SET,
    ENTER, /* initialization mode, with start and stop time */
    INITIALIZE,
    STEP,
    GET,
    EXCHANGE, /* SET, STEP and GET in one request */
    SAVE,
    RESTORE,
    TERMINATE,
    STATISTICS
} Code;

/* statuses of answers besides the values of fmi2Status */
typedef enum {
    DAMAGED = 64, /* a damaged frame has arrived; its sequence number is unknown */
    OTHER_VERSION,
    NO_COMPONENT,
    NO_SESSION, /* no DESCRIBE since the start of the board */
    MALFORMED   /* an undamaged frame that is no valid request, or whose answer is too long */
} Trouble;

typedef enum { REAL_TYPE, INTEGER_TYPE, BOOLEAN_TYPE } ValueType;
enum { TYPE_COUNT = BOOLEAN_TYPE + 1 };

static const double probe_value =
    -1.25e-3; /* in descriptions: shows that both ends use the same format of doubles */
static const unsigned char frame_magic[4] = {'S', 'L', 'N', 'K'};

/* ---- CRC-32 of IEEE 802.3 (reflected, polynomial 0x04C11DB7), four bits per step */
static inline uint32_t crc_of(uint32_t crc, const void *bytes, size_t count)
{
    static const uint32_t half_byte[16] = {0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac,
                                           0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
                                           0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c,
                                           0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};
    const unsigned char *b = bytes;
    crc = ~crc;
    while (count-- > 0) {
        crc ^= *b++;
        crc = crc >> 4 ^ half_byte[crc & 15];
        crc = crc >> 4 ^ half_byte[crc & 15];
    }
    return ~crc;
}

/* ---- numbers in frames */
static inline void store(unsigned char *to, uint64_t value, size_t bytes)
{
    for (size_t i = 0; i < bytes; i++) to[i] = (unsigned char)(value >> 8 * i);
}
static inline uint64_t load(const unsigned char *from, size_t bytes)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++) value |= (uint64_t)from[i] << 8 * i;
    return value;
}

typedef struct {
    unsigned char *bytes;
    size_t size, used;
    bool full;
} Writer;

static inline void put_bytes(Writer *w, const void *bytes, size_t count)
{
    if (count > w->size - w->used) w->full = true;
    if (w->full) return;
    if (count) memcpy(w->bytes + w->used, bytes, count);
    w->used += count;
}
static inline void put_number(Writer *w, uint64_t value, size_t bytes)
{
    unsigned char buffer[8];
    store(buffer, value, bytes);
    put_bytes(w, buffer, bytes);
}
static inline void put_double(Writer *w, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_number(w, bits, sizeof bits);
}
static inline void put_text(Writer *w, const char *text)
{
    size_t length = strlen(text);
    put_number(w, length, 4);
    put_bytes(w, text, length);
}

typedef struct {
    const unsigned char *bytes;
    size_t left;
    bool truncated; /* more bytes were requested than available */
} Reader;

static inline const unsigned char *take_bytes(Reader *r, size_t count)
{
    const unsigned char *at = r->bytes;
    if (count > r->left) r->truncated = true;
    if (r->truncated) return NULL;
    r->bytes += count;
    r->left -= count;
    return at;
}
static inline uint64_t take_number(Reader *r, size_t bytes)
{
    const unsigned char *at = take_bytes(r, bytes);
    return at ? load(at, bytes) : 0;
}
static inline double take_double(Reader *r)
{
    uint64_t bits = take_number(r, 8);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}
/* text from a frame, cut to the size of the buffer; returns the buffer */
static inline const char *take_text(Reader *r, char *buffer, size_t size)
{
    size_t length = take_number(r, 4);
    const unsigned char *at = take_bytes(r, length);
    size_t copied = !at ? 0 : length < size ? length : size - 1;
    if (copied) memcpy(buffer, at, copied);
    buffer[copied] = 0;
    return buffer;
}

/* ---- runs: groups of neighbouring value references, given by type, count and first reference */
typedef struct {
    ValueType type;
    uint16_t count;
    uint32_t first;
} RunOf;

enum { RUN_SIZE = 7 };

static inline void put_run(Writer *w, RunOf run)
{
    put_number(w, run.type, 1);
    put_number(w, run.count, 2);
    put_number(w, run.first, 4);
}
static inline RunOf take_run(Reader *r)
{
    unsigned type = (unsigned)take_number(r, 1);
    uint16_t count = (uint16_t)take_number(r, 2);
    RunOf run = {type < TYPE_COUNT ? (ValueType)type : REAL_TYPE, count,
                 (uint32_t)take_number(r, 4)};
    if (type >= TYPE_COUNT) r->truncated = true;
    return run;
}
static inline size_t value_size(ValueType type) { return type == REAL_TYPE ? 8 : 4; }

/* ---- frames */
typedef struct {
    uint8_t version, code, component, status;
    uint32_t sequence;
    Reader payload;
} Frame;

/* completes a frame whose payload is at bytes + HEADER_SIZE: writes header and CRC, returns the
 * size of the frame */
static inline size_t finish_frame(unsigned char *bytes, Frame f, size_t length)
{
    const uint8_t numbers[4] = {PROTOCOL_VERSION, f.code, f.component, f.status};
    memcpy(bytes, frame_magic, 4);
    memcpy(bytes + 4, numbers, 4);
    store(bytes + 8, f.sequence, 4);
    store(bytes + 12, length, 4);
    uint32_t crc = crc_of(0, bytes, HEADER_SIZE - CRC_SIZE);
    store(bytes + 16, crc, CRC_SIZE);
    crc = crc_of(0, bytes, HEADER_SIZE + length);
    store(bytes + HEADER_SIZE + length, crc, CRC_SIZE);
    return HEADER_SIZE + length + CRC_SIZE;
}

typedef enum { INCOMPLETE, COMPLETE, NOISE } Found;

/* finds what `count` bytes begin with: a COMPLETE frame of `size` bytes, an INCOMPLETE frame, or
 * NOISE, `size` bytes to skip */
static inline Found find_frame(const unsigned char *bytes, size_t count, Frame *f, size_t *size)
{
    size_t matching = 0;
    while (matching < 4 && matching < count && bytes[matching] == frame_magic[matching]) matching++;
    *size = 1;
    if (matching < 4 && matching < count) return NOISE;
    if (count < HEADER_SIZE) return INCOMPLETE;
    size_t length = load(bytes + 12, 4);
    if (load(bytes + 16, CRC_SIZE) != crc_of(0, bytes, HEADER_SIZE - CRC_SIZE)) return NOISE;
    *f = (Frame){bytes[4],
                 bytes[5],
                 bytes[6],
                 bytes[7],
                 (uint32_t)load(bytes + 8, 4),
                 {bytes + HEADER_SIZE, length, false}};
    if (length > PAYLOAD_LIMIT) return NOISE;
    if (count < HEADER_SIZE + length + CRC_SIZE) return INCOMPLETE;
    if (load(bytes + HEADER_SIZE + length, CRC_SIZE) != crc_of(0, bytes, HEADER_SIZE + length))
        return NOISE;
    *size = HEADER_SIZE + length + CRC_SIZE;
    return COMPLETE;
}

#endif
