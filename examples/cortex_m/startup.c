/* Start of a Cortex-M4F or M7 on the boards MPS2 that QEMU emulates: vector table, floating-point unit, C library. */
#include <stdint.h>
#include <stdlib.h>

extern uint32_t stack_top[], bss_start[], bss_end[];
extern void initialise_monitor_handles(void); /* of newlib's semihosting: opens stdout on the host */
extern int main(void);

void reset(void);
void fault(void);

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    stack_top, (void *)reset, (void *)fault, (void *)fault, (void *)fault, (void *)fault, (void *)fault};

void reset(void)
{
    volatile uint32_t *const coprocessors = (volatile uint32_t *)0xE000ED88u; /* CPACR */
    uint32_t *word;
    *coprocessors |= 0xFu << 20; /* full access to the floating-point unit */
    __asm volatile("dsb\n\tisb");
    for (word = bss_start; word < bss_end; word++) {
        *word = 0;
    }
    initialise_monitor_handles();
    exit(main());
}

void fault(void)
{
    exit(2);
}

/* What newlib's exit expects of a start without constructors. */
void _init(void);
void _fini(void);
void _init(void) {}
void _fini(void) {}
