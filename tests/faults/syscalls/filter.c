// SPDX-FileCopyrightText: 2026 The terrain_estimator authors
// SPDX-License-Identifier: Apache-2.0
//
// Makes one system call on chosen files fail; for LD_PRELOAD. The program arms it with fault_arm().
// Counted are open for writing, write, fsync, rename, close and mkdir below one folder, from 1.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum kind { NOTHING, FAIL_IO, FAIL_SPACE, SHORT, INTERRUPT };
enum call { OPEN, WRITE, FSYNC, RENAME, CLOSE, MKDIR };

#define DESCRIPTORS 4096
static char folder[PATH_MAX];
static long which, seen, hits;
static enum kind kind;
static int last_call = -1;
static unsigned char ours[DESCRIPTORS];
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

// Counts from now on, and lets call number ``n`` fail; 0 counts only.
void fault_arm(const char *below, long n, int how) {
    snprintf(folder, sizeof folder, "%s", below);
    memset(ours, 0, sizeof ours);
    which = n, seen = hits = 0, kind = how, last_call = -1;
}

// A program that knows nothing of the filter is armed by its environment.
__attribute__((constructor)) static void from_environment(void) {
    const char *below = getenv("FAULT_FOLDER"), *n = getenv("FAULT_NUMBER"), *how = getenv("FAULT_KIND");
    if (below && n && how) fault_arm(below, atol(n), atoi(how));
}

void fault_disarm(void) { folder[0] = 0; }
long fault_seen(void) { return seen; }
long fault_hits(void) { return hits; }
int fault_call(void) { return last_call; }

// Whether a call fails now. A disk that is full stays full for all that needs space.
static int fails(enum call call, int needs_space) {
    int result = 0;
    pthread_mutex_lock(&lock);
    long number = ++seen;
    if (which && number == which) {
        result = kind != NOTHING;
        if (kind == SHORT) result = call == WRITE;
        if (kind == INTERRUPT) result = call == OPEN || call == WRITE || call == FSYNC || call == CLOSE;
        if (result) last_call = call;
    } else if (which && number > which && kind == FAIL_SPACE) {
        result = needs_space;
    }
    hits += result;
    pthread_mutex_unlock(&lock);
    return result;
}

static int error_number(void) {
    return kind == FAIL_SPACE ? ENOSPC : kind == INTERRUPT ? EINTR : EIO;
}

static int below(const char *path) {
    size_t length = strlen(folder);
    return length && strncmp(path, folder, length) == 0 && (path[length] == '/' || path[length] == 0);
}

// Whether a path, which may be relative to an open folder, lies below the chosen one.
static int chosen(int at, const char *path) {
    char whole[2 * PATH_MAX], link[64];
    if (!folder[0] || !path) return 0;
    if (path[0] == '/') return below(path);
    if (at == AT_FDCWD) {
        if (!getcwd(whole, PATH_MAX)) return 0;
    } else {
        snprintf(link, sizeof link, "/proc/self/fd/%d", at);
        ssize_t n = readlink(link, whole, PATH_MAX - 1);
        if (n < 0) return 0;
        whole[n] = 0;
    }
    strncat(whole, "/", sizeof whole - strlen(whole) - 1);
    strncat(whole, path, sizeof whole - strlen(whole) - 1);
    return below(whole);
}

static int own(int descriptor) {
    return folder[0] && descriptor >= 0 && descriptor < DESCRIPTORS && ours[descriptor];
}

static int opened(int descriptor, int mine) {
    if (mine && descriptor >= 0 && descriptor < DESCRIPTORS) ours[descriptor] = 1;
    return descriptor;
}

static int open_at(int at, const char *path, int flags, mode_t mode) {
    static int (*real)(int, const char *, int, ...);
    if (!real) real = dlsym(RTLD_NEXT, "openat");
    // folders are opened for their fsync
    int mine = ((flags & O_ACCMODE) != O_RDONLY || flags & O_DIRECTORY) && chosen(at, path);
    struct stat status;
    if (!mine && folder[0] && chosen(at, path) && fstatat(at, path, &status, 0) == 0 && S_ISDIR(status.st_mode))
        mine = 1;
    if (mine && fails(OPEN, flags & O_CREAT)) {
        errno = error_number();
        return -1;
    }
    return opened(real(at, path, flags, mode), mine);
}

#define MODE(flags, mode)                                \
    mode_t mode = 0;                                     \
    if (flags & (O_CREAT | O_TMPFILE)) {                 \
        va_list rest;                                    \
        va_start(rest, flags);                           \
        mode = va_arg(rest, mode_t);                     \
        va_end(rest);                                    \
    }

int open(const char *path, int flags, ...) { MODE(flags, mode) return open_at(AT_FDCWD, path, flags, mode); }
int open64(const char *path, int flags, ...) { MODE(flags, mode) return open_at(AT_FDCWD, path, flags | O_LARGEFILE, mode); }
int openat(int at, const char *path, int flags, ...) { MODE(flags, mode) return open_at(at, path, flags, mode); }
int openat64(int at, const char *path, int flags, ...) { MODE(flags, mode) return open_at(at, path, flags | O_LARGEFILE, mode); }

ssize_t write(int descriptor, const void *data, size_t size) {
    static ssize_t (*real)(int, const void *, size_t);
    if (!real) real = dlsym(RTLD_NEXT, "write");
    if (own(descriptor) && fails(WRITE, 1)) {
        if (kind == SHORT && size > 1) return real(descriptor, data, size / 2);
        if (kind == SHORT) return real(descriptor, data, size);
        errno = error_number();
        return -1;
    }
    return real(descriptor, data, size);
}

int fsync(int descriptor) {
    static int (*real)(int);
    if (!real) real = dlsym(RTLD_NEXT, "fsync");
    if (own(descriptor) && fails(FSYNC, 1)) {
        errno = error_number();
        return -1;
    }
    return real(descriptor);
}

int close(int descriptor) {
    static int (*real)(int);
    if (!real) real = dlsym(RTLD_NEXT, "close");
    int mine = own(descriptor);
    if (mine) ours[descriptor] = 0;
    int result = real(descriptor);
    if (mine && fails(CLOSE, 0)) {  // Linux frees the descriptor also where it reports an error
        errno = error_number();
        return -1;
    }
    return result;
}

static int rename_at(int from, const char *old, int to, const char *new, unsigned flags) {
    static int (*real)(int, const char *, int, const char *, unsigned);
    if (!real) real = dlsym(RTLD_NEXT, "renameat2");
    if ((chosen(from, old) || chosen(to, new)) && fails(RENAME, 0)) {
        errno = error_number();
        return -1;
    }
    return real(from, old, to, new, flags);
}

int rename(const char *old, const char *new) { return rename_at(AT_FDCWD, old, AT_FDCWD, new, 0); }
int renameat(int from, const char *old, int to, const char *new) { return rename_at(from, old, to, new, 0); }

int mkdir(const char *path, mode_t mode) {
    static int (*real)(const char *, mode_t);
    if (!real) real = dlsym(RTLD_NEXT, "mkdir");
    if (chosen(AT_FDCWD, path) && fails(MKDIR, 1)) {
        errno = error_number();
        return -1;
    }
    return real(path, mode);
}
