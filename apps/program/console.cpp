#include "apps/program/console.hpp"

#include <iostream>

#include "apps/program/colour.hpp"

namespace orbid::apps {

bool Console::colours_out(std::string_view choice) const {
    return is_coloured(choice, out_terminal);
}

bool Console::colours_error(std::string_view choice) const {
    return is_coloured(choice, error_terminal);
}

Console standard_console(bool own_process) {
    return {std::cout, std::cerr, stdout, stderr, true, own_process};
}

}  // namespace orbid::apps
