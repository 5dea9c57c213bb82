#include <algorithm>
#include <exception>
#include <iostream>
#include <string>

#include "apps/program/command_line.hpp"

int main(int count, char** arguments) {
    try {
        return orbid::apps::run_command({arguments + 1, arguments + count}, true);
    } catch (const std::exception& error) {
        // Whatever it names, it only shows itself.
        std::string text = error.what();
        std::replace_if(
            text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c >= 0x7F; }, '?');
        std::cerr << "orbid: internal error: " << text << '\n';
        return 4;
    }
}
