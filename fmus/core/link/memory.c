/* memory.c - memcpy by words for the processors of boards.
 *
 * The memcpy of a board's C library (picolibc, compiled for small size) needs four instructions per
 * byte on Arm and six on RISC-V. An FMU copies its state in every step, and compilers copy
 * structures by memcpy. If both addresses are aligned to words, this function needs a sixth of
 * these instructions on Arm, a tenth on 32-bit and a twentieth on 64-bit RISC-V. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stddef.h>
#include <stdint.h>

typedef uintptr_t __attribute__((may_alias)) Word;

enum { SIZE = sizeof(Word), BLOCK = 8 }; /* bytes per word; words copied per pass of the loop */

void *memcpy(void *restrict to, const void *restrict from, size_t size);

/* memcpy; the attribute prevents the compiler from replacing these loops by a call of memcpy */
__attribute__((optimize("no-tree-loop-distribute-patterns"))) void *
memcpy(void *restrict to, const void *restrict from, size_t size)
{
    unsigned char *byte = to;
    const unsigned char *source = from;
    if (((uintptr_t)to | (uintptr_t)from) % SIZE == 0) {
        Word *word = to;
        const Word *read = from;
        for (; size >= BLOCK * SIZE; size -= BLOCK * SIZE, word += BLOCK, read += BLOCK) {
            Word a = read[0], b = read[1], c = read[2], d = read[3];
            word[0] = a, word[1] = b, word[2] = c, word[3] = d;
            a = read[4], b = read[5], c = read[6], d = read[7];
            word[4] = a, word[5] = b, word[6] = c, word[7] = d;
        }
        for (; size >= SIZE; size -= SIZE) *word++ = *read++;
        byte = (unsigned char *)word;
        source = (const unsigned char *)read;
    }
    for (; size > 0; size--) *byte++ = *source++;
    return to;
}
