/* The start of a program on the Cortex-M4 that QEMU has: the table of vectors, and the FPU on. */
void _start(void);
void _init(void);
void _fini(void);
void reset(void);

void reset(void)
{
    *(volatile unsigned *)0xE000ED88 |= 0xFu << 20; /* CPACR: access to the FPU */
    __asm__ volatile("dsb\n\tisb");
    _start();
}

static void fault(void)
{
    for (;;)
        ;
}

__attribute__((section(".vectors"), used)) static void (*const vectors[16])(void) = {
    (void (*)(void))0x20400000, reset, fault, fault, fault, fault, fault };

/* What newlib calls before main and after it: there is nothing to do. */
void _init(void) {}
void _fini(void) {}
