// own-network COMMAND...: the command in a network of its own, which own_network.cpp makes.
#include <unistd.h>

#include <cstdio>

int main(int, char** argv) {
    if (argv[1] != nullptr)
        execvp(argv[1], argv + 1);
    std::perror("own-network");
    return 127;
}
