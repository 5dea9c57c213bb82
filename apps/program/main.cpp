#include <exception>
#include <iostream>

#include "apps/documents/printable.hpp"
#include "apps/program/command_line.hpp"

int main(int count, char** arguments) {
    try {
        return orbid::apps::run_command({arguments + 1, arguments + count}, true);
    } catch (const std::exception& error) {
        std::cerr << "orbid: internal error: " << orbid::apps::printable(error.what()) << '\n';
        return 4;
    }
}
