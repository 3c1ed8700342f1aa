/* Loaded before the C library: the n-th write (or sync) below a folder fails, and with `stay` every
 * later one too, until a file named .reserve is removed there: a disk that is full. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static char prefix[PATH_MAX];
static long left = -1, done_writes, done_syncs;
static int code, stay, syncs_only, failing;

void fault_arm(const char *folder, long number, int error, int stays, int only_syncs) {
    snprintf(prefix, sizeof prefix, "%s", folder);
    left = number; code = error; stay = stays; syncs_only = only_syncs;
    failing = 0; done_writes = done_syncs = 0;
}
void fault_disarm(void) { left = -1; failing = 0; prefix[0] = 0; }
long fault_writes(void) { return done_writes; }
long fault_syncs(void) { return done_syncs; }

static int below(int handle) {
    char link[64], path[PATH_MAX];
    if (!prefix[0]) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t size = readlink(link, path, sizeof path - 1);
    if (size < 0) return 0;
    path[size] = 0;
    return strncmp(path, prefix, strlen(prefix)) == 0;
}
static int fails(int handle, int is_sync) {
    if (!below(handle)) return 0;
    if (is_sync) done_syncs++; else done_writes++;
    if (failing && stay && (!is_sync || code == EIO)) { errno = code; return 1; }
    if (left < 0 || is_sync != syncs_only) return 0;
    if (left-- > 0) return 0;
    failing = 1;
    errno = code;
    return 1;
}
#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, name)

ssize_t write(int handle, const void *data, size_t size) {
    REAL(ssize_t, "write", int, const void *, size_t);
    return fails(handle, 0) ? -1 : real(handle, data, size);
}
int fsync(int handle) {
    REAL(int, "fsync", int);
    return fails(handle, 1) ? -1 : real(handle);
}
int fdatasync(int handle) {
    REAL(int, "fdatasync", int);
    return fails(handle, 1) ? -1 : real(handle);
}
int posix_fallocate(int handle, off_t at, off_t size) {
    REAL(int, "posix_fallocate", int, off_t, off_t);
    return fails(handle, 0) ? errno : real(handle, at, size);
}
int posix_fallocate64(int handle, off_t at, off_t size) {
    REAL(int, "posix_fallocate64", int, off_t, off_t);
    return fails(handle, 0) ? errno : real(handle, at, size);
}
int unlink(const char *path) {
    REAL(int, "unlink", const char *);
    size_t size = strlen(path);
    if (failing && code == ENOSPC && size > 8 && !strcmp(path + size - 8, ".reserve")) {
        failing = 0; left = -1;
    }
    return real(path);
}
