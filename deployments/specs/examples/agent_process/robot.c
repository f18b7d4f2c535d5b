/* The robot as a program in C: pushes the cart under the falling pole.
 *
 * Plain C99 and POSIX, for little-endian machines; docs/robot-programs.md has the protocol that it speaks.
 * Build it with: cc -std=c99 -O2 -o robot robot.c
 */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

enum { HELLO = 1, OBSERVATION = 2, ACTION = 3, END = 4, ERROR = 5 };

struct header {
    uint32_t length, type;
};

struct action {
    struct header header;
    uint64_t number; /* of the observation that it answers */
    double push;
};

static void fail(const char *what) {
    fprintf(stderr, "robot: %s\n", what);
    exit(1);
}

/* Connects to the simulation's socket; tries for 30 s, since the program may be there first. */
static int connect_to(const char *path) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (path == NULL || strlen(path) >= sizeof address.sun_path) fail("ROBOMAKER_AGENT_SOCKET names no socket");
    strcpy(address.sun_path, path);
    for (int tries = 0; tries < 600; tries++) {
        int connection = socket(AF_UNIX, SOCK_STREAM, 0);
        if (connect(connection, (struct sockaddr *)&address, sizeof address) == 0) return connection;
        close(connection);
        nanosleep(&(struct timespec){.tv_nsec = 50000000}, NULL);
    }
    fail("no simulation listens");
    return -1;
}

static void send_all(int connection, const void *bytes, size_t count) {
    const char *next = bytes;
    while (count > 0) {
        ssize_t sent = send(connection, next, count, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR) continue;
        if (sent <= 0) fail("the simulation is gone");
        next += sent;
        count -= (size_t)sent;
    }
}

static void receive_all(int connection, void *bytes, size_t count) {
    char *next = bytes;
    while (count > 0) {
        ssize_t received = recv(connection, next, count, 0);
        if (received < 0 && errno == EINTR) continue;
        if (received <= 0) fail("the simulation is gone");
        next += received;
        count -= (size_t)received;
    }
}

/* Receives a message; its content, with a zero added, lasts until the next one. */
static char *receive_message(int connection, struct header *header) {
    static char *content;
    receive_all(connection, header, sizeof *header);
    content = realloc(content, (size_t)header->length + 1);
    if (content == NULL) fail("out of memory");
    receive_all(connection, content, header->length);
    content[header->length] = '\0';
    if (header->type == ERROR) fail(content);
    return content;
}

/* Where an array of the observation begins. JSON comes without blanks and in a fixed order, so searching will do. */
static size_t offset_of(const char *hello, const char *path, const char *form) {
    char wanted[128];
    snprintf(wanted, sizeof wanted, "{\"path\":[\"%s\"],%s,\"offset\":", path, form);
    const char *found = strstr(hello, "\"observation\":");
    found = found ? strstr(found, wanted) : NULL;
    if (found == NULL) fail("the environment does not give what this robot needs");
    return strtoul(found + strlen(wanted), NULL, 10);
}

int main(void) {
    const double gains[4] = {0.1, 4.0, 0.2, 0.8};
    const char *greeting = "{\"version\":1,\"mode\":\"lockstep\"}";
    const char *two_doubles = "\"dtype\":\"float64\",\"shape\":[2]";
    struct header header;
    int connection = connect_to(getenv("ROBOMAKER_AGENT_SOCKET"));

    char *content = receive_message(connection, &header);
    if (header.type != HELLO || strstr(content, "\"protocol\":\"robomaker-agent\"") == NULL) fail("not a simulation");
    size_t position = offset_of(content, "position", two_doubles);
    size_t velocity = offset_of(content, "velocity", two_doubles);
    header = (struct header){(uint32_t)strlen(greeting), HELLO};
    send_all(connection, &header, sizeof header);
    send_all(connection, greeting, header.length);

    for (;;) {
        content = receive_message(connection, &header);
        if (header.type == END) break;
        if (header.type != OBSERVATION) fail("not an observation");
        double state[4];
        memcpy(&state[0], content + position, 2 * sizeof(double));
        memcpy(&state[2], content + velocity, 2 * sizeof(double));
        struct action action = {{sizeof action - sizeof header, ACTION}, 0, 0.0};
        memcpy(&action.number, content, sizeof action.number);
        for (int i = 0; i < 4; i++) action.push += gains[i] * state[i];
        if (action.push > 1.0) action.push = 1.0;
        if (action.push < -1.0) action.push = -1.0;
        send_all(connection, &action, sizeof action);
    }
    printf("the run is over: %s\n", content);
    return 0;
}
