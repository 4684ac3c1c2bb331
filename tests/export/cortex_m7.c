/* Start of a Cortex-M7 that runs a program through semihosting: the vector table, and the processor's unit for
   floating-point numbers switched on. */
#include <stdint.h>
#include <stdlib.h>
#include <unistd.h>

extern uint32_t stack_top;
extern uint32_t bss_begin;
extern uint32_t bss_end;
int main(void);
void initialise_monitor_handles(void);
void start(void);
void stop(void);
/* The C library asks for these where there are no start files. */
void _init(void);
void _fini(void);
void _init(void) {}
void _fini(void) {}

/* A fault ends the program, so that nobody waits for it. */
void stop(void)
{
    _exit(9);
}

void start(void)
{
    uint32_t *word;
    volatile uint32_t *access = (volatile uint32_t *)0xE000ED88u;
    *access |= 0xFu << 20;
    __asm volatile("dsb\n isb");
    for (word = &bss_begin; word < &bss_end; word++)
    {
        *word = 0u;
    }
    initialise_monitor_handles();
    exit(main());
}

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[4] = {
    (uintptr_t)&stack_top, (uintptr_t)start, (uintptr_t)stop, (uintptr_t)stop
};
