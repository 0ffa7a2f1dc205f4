/* Lets user-mode Linux run on processors whose saved register state is larger than its buffer for it.
 *
 * Linux takes a register state only whole (PTRACE_SETREGSET of NT_X86_XSTATE), user-mode Linux 6.1 hands over
 * the part it knows, up to AVX. This wrapper, preloaded, adds the rest as the traced process has it now:
 * read everything, write the known part over it, give everything back. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

#define LARGEST_STATE (64 * 1024)

typedef long ptrace_call(enum __ptrace_request, pid_t, void *, void *);

static long set_whole_state(ptrace_call *real, pid_t process, void *kind, const struct iovec *known)
{
    static char state[LARGEST_STATE];
    struct iovec whole = {state, sizeof state};

    if (real(PTRACE_GETREGSET, process, kind, &whole) < 0)
        return -1;
    memcpy(state, known->iov_base, known->iov_len < whole.iov_len ? known->iov_len : whole.iov_len);
    return real(PTRACE_SETREGSET, process, kind, &whole);
}

long ptrace(enum __ptrace_request request, ...)
{
    static ptrace_call *real;
    va_list arguments;

    va_start(arguments, request);
    pid_t process = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (!real)
        real = (ptrace_call *)dlsym(RTLD_NEXT, "ptrace");
    long result = real(request, process, address, data);
    if (result < 0 && request == PTRACE_SETREGSET && (long)address == NT_X86_XSTATE)
        return set_whole_state(real, process, address, data);
    return result;
}
