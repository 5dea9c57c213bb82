#include "apps/command_help.hpp"

#include <fmt/format.h>

#include "apps/command_table.hpp"

namespace orbid::apps {

namespace {

/// Text broken at blanks so that lines, indented by `indent`, keep within 80 columns. The first is not indented.
std::string wrapped(const std::string& text, std::size_t indent) {
    constexpr std::size_t columns = 80;
    std::string result;
    std::size_t column = indent;
    for (std::size_t begin = 0; begin < text.size();) {
        std::size_t end = text.find(' ', begin);
        if (end == std::string::npos) end = text.size();
        const std::size_t width = end - begin;
        if (column > indent && column + 1 + width > columns) {
            result += "\n" + std::string(indent, ' ');
            column = indent;
        } else if (column > indent) {
            result += ' ';
            ++column;
        }
        result.append(text, begin, width);
        column += width;
        begin = end + 1;
    }
    return result;
}

std::string joined(const std::vector<std::string>& names) {
    std::string text;
    for (const std::string& name : names)
        text += (text.empty() ? "" : ", ") + name;
    return text;
}

std::string option_text(const CommandOption& option) {
    const std::string left = "--" + option.name + (option.value.empty() ? "" : " " + option.value);
    std::string meaning = option.meaning;
    if (option.choices != nullptr) meaning += ": " + joined(option.choices());
    constexpr std::size_t indent = 19;
    return fmt::format("  {:<16} {}\n", left, wrapped(meaning, indent));
}

}  // namespace

std::string usage_words(const Command& command) {
    std::string text;
    for (const CommandWord& word : command.words) {
        if (!text.empty()) text += ' ';
        text += word.optional ? "[" + word.name + "]" : word.name;
    }
    return text;
}

std::string program_help() {
    std::string text = "orbid: parameters of nonlinear systems from chaotic data\n\nusage: orbid COMMAND [options]\n\n";
    for (const Command& command : command_table()) {
        if (command.run == nullptr) continue;
        constexpr std::size_t indent = 26;
        text +=
            fmt::format("  {:<9} {:<13} {}\n", command.name, usage_words(command), wrapped(command.summary, indent));
    }
    return text +
           "\n  --version, --help, COMMAND --help\n\n"
           "exit codes: 0 done; 1 done, but no valid answer; 2 wrong command line or job;\n"
           "            3 data cannot be used; 4 internal error; 130 interrupted\n";
}

std::string command_help(const Command& command) {
    std::string text = fmt::format("orbid {}: {}\n\nusage: orbid {}{}{} [options]\n\n", command.name, command.summary,
                                   command.name, command.words.empty() ? "" : " ", usage_words(command));
    for (const CommandWord& word : command.words) {
        if (word.choices == nullptr) continue;
        constexpr std::size_t indent = 19;
        text += fmt::format("  {:<16} {}\n", word.name, wrapped(joined(word.choices()), indent));
    }
    text += "options:\n";
    for (const CommandOption& option : command.options)
        text += option_text(option);
    for (const CommandOption& option : common_options())
        text += option_text(option);
    if (!command.details.empty()) text += "\n" + command.details + "\n";
    text += command.examples.size() > 1 ? "\nexamples:\n" : "\nexample:\n";
    for (const CommandExample& example : command.examples) {
        text += "  " + example.line + "\n";
        if (!example.meaning.empty()) text += "      " + wrapped(example.meaning, 6) + "\n";
    }
    return text;
}

}  // namespace orbid::apps
