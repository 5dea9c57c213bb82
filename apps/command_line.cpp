#include "apps/command_line.hpp"

#include <algorithm>
#include <charconv>
#include <iostream>

#include <fmt/format.h>

#include "apps/command_help.hpp"
#include "apps/command_table.hpp"
#include "apps/json_reader.hpp"
#include "apps/version.hpp"

namespace orbid::apps {

namespace {

constexpr int wrong_command_line = 2;

/// An option of a command, or one that all have.
const CommandOption* find_option(const Command& command, const std::string& name) {
    for (const auto* options : {&command.options, &common_options()}) {
        for (const CommandOption& option : *options) {
            if (option.name == name) return &option;
        }
    }
    return nullptr;
}

std::vector<std::string> option_names(const Command& command) {
    std::vector<std::string> names;
    for (const auto* options : {&command.options, &common_options()}) {
        for (const CommandOption& option : *options)
            names.push_back("--" + option.name);
    }
    return names;
}

/// Words and options of one command. Names of options are written in full: a later option must not change what an old
/// script means.
CommandCall parsed(const Command& command, const std::vector<std::string>& arguments) {
    const auto refuse = [&command](const std::string& reason) {
        throw CommandLineError(fmt::format("orbid {}: {}", command.name, reason));
    };
    CommandCall call;
    call.command = command.name;
    bool only_words = false;
    for (std::size_t i = 0; i < arguments.size(); ++i) {
        const std::string& argument = arguments[i];
        if (only_words || argument.size() < 2 || argument[0] != '-') {
            call.words.push_back(argument);
            continue;
        }
        if (argument == "--") {
            only_words = true;
            continue;
        }
        const std::string written = argument == "-h" ? "--help" : argument.substr(0, argument.find('='));
        const CommandOption* option = written.starts_with("--") ? find_option(command, written.substr(2)) : nullptr;
        if (option == nullptr)
            refuse(fmt::format("there is no option \"{}\"{}", written, suggestion(written, option_names(command))));
        if (call.has(option->name)) refuse(fmt::format("\"{}\" is given twice", written));
        const bool has_value = written.size() < argument.size() && argument != "-h";
        std::string value;
        if (option->value.empty()) {
            if (has_value) refuse(fmt::format("\"{}\" takes no value", written));
        } else if (has_value) {
            value = argument.substr(written.size() + 1);
        } else {
            if (i + 1 == arguments.size()) refuse(fmt::format("\"{}\" needs a value: {}", written, option->value));
            value = arguments[++i];
        }
        if (option->choices != nullptr) {
            const auto choices = option->choices();
            if (std::find(choices.begin(), choices.end(), value) == choices.end()) {
                refuse(fmt::format("{} must be one of {}, not \"{}\"", written, fmt::join(choices, ", "), value));
            }
        }
        call.options[option->name] = value;
    }
    return call;
}

void need_words(const Command& command, const CommandCall& call) {
    const auto needed = std::count_if(command.words.begin(), command.words.end(),
                                      [](const CommandWord& word) { return !word.optional; });
    if (call.words.size() >= static_cast<std::size_t>(needed) && call.words.size() <= command.words.size()) return;
    throw CommandLineError(fmt::format("orbid {} takes {}, not {} arguments; see orbid {} --help", command.name,
                                       command.words.empty() ? "no arguments" : usage_words(command), call.words.size(),
                                       command.name));
}

int run_known(const std::vector<std::string>& arguments) {
    if (arguments.empty()) throw CommandLineError(program_help());
    const std::string& first = arguments.front();
    if (first == "--help" || first == "-h" || first == "help") {
        std::cout << program_help();
        return 0;
    }
    if (first == "--version") {
        std::cout << "orbid " << program_version() << '\n';
        return 0;
    }
    std::vector<std::string> names;
    for (const Command& command : command_table()) {
        if (command.run != nullptr) names.push_back(command.name);
        if (command.name != first) continue;
        if (command.run == nullptr) throw CommandLineError(fmt::format("orbid {}: {}", first, not_in_this_version));
        const CommandCall call = parsed(command, {arguments.begin() + 1, arguments.end()});
        if (call.has("help")) {
            std::cout << command_help(command);
            return 0;
        }
        need_words(command, call);
        return command.run(call);
    }
    throw CommandLineError(fmt::format("there is no command \"{}\"{}", first, suggestion(first, names)));
}

}  // namespace

int CommandCall::whole_number(const std::string& option, int without, int lowest) const {
    if (!has(option)) return without;
    const std::string text = value(option, "");
    int number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc() || end != text.data() + text.size())
        throw CommandLineError(fmt::format("--{} must be a whole number, not \"{}\"", option, text));
    if (number < lowest) throw CommandLineError(fmt::format("--{} must be >= {}, not {}", option, lowest, number));
    return number;
}

int run_command(const std::vector<std::string>& arguments) {
    try {
        return run_known(arguments);
    } catch (const CommandLineError& error) {
        std::cerr << error.what() << '\n';
        return wrong_command_line;
    }
}

}  // namespace orbid::apps
