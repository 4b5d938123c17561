/* Functions that both versions of FMI have, in the types and names of fmi2.h or fmi3.h. */
#ifndef COMMON_H
#define COMMON_H

#define REPORT(c, call) \
    reason_t reason = { "" }, *why = &reason; \
    const status_t status = (call); \
    return report(c, status, why)

/* Only sentences about a status are logged, and those always. */
EXPORT fmi_status FMI(SetDebugLogging)(void *c, fmi_boolean on, size_t n,
    const char *const names[])
{
    (void)on, (void)n, (void)names;
    return report(c, CORE_OK, NULL);
}

EXPORT void FMI(FreeInstance)(void *c) { free(c); }
EXPORT fmi_status FMI(ExitInitializationMode)(void *c) { REPORT(c, core_exit(MODEL(c), why)); }
EXPORT fmi_status FMI(Terminate)(void *c) { REPORT(c, core_terminate(MODEL(c), why)); }

EXPORT fmi_status FMI(Reset)(void *c)
{
    *MODEL(c) = initial;
    return report(c, CORE_OK, NULL);
}

EXPORT fmi_status FMI_STATE(Get)(void *c, void **state)
{
    REPORT(c, core_keep(MODEL(c), state, why));
}

EXPORT fmi_status FMI_STATE(Set)(void *c, void *state)
{
    REPORT(c, core_restore(MODEL(c), state, why));
}

EXPORT fmi_status FMI_STATE(Free)(void *c, void **state)
{
    free(*state);
    *state = NULL;
    return report(c, CORE_OK, NULL);
}

EXPORT fmi_status FMI_STATE_SIZE(void *c, void *state, size_t *size)
{
    (void)state;
    *size = STATE_BYTES;
    return report(c, CORE_OK, NULL);
}

EXPORT fmi_status FMI_STATE(Serialize)(void *c, void *state, fmi_byte bytes[], size_t size)
{
    REPORT(c, core_write(state, (unsigned char *)bytes, size, why));
}

EXPORT fmi_status FMI_DESERIALIZE(void *c, const fmi_byte bytes[], size_t size,
    void **state)
{
    REPORT(c, core_read((const unsigned char *)bytes, size, state, why));
}

#endif
