#pragma once

#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "apps/program/console.hpp"

namespace orbid::apps {

// Exit codes of the program, see docs/command_line.md.
inline constexpr int success = 0;
inline constexpr int no_valid_answer = 1;
inline constexpr int wrong_call = 2;
inline constexpr int unusable_data = 3;
inline constexpr int not_stored = 4;
inline constexpr int out_of_memory = 5;
inline constexpr int ended_by_signal = 130;

/// An invalid command line; the message gives the reason and the word. Exit code 2.
class CommandLineError : public std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

/// What a word of the command line names, for shell completion.
enum class WordKind { text, number, job_file, file, folder, choice };

/// A positional word of a command, as its usage shows it: "JOB.json", "[TASK]".
struct CommandWord {
    std::string name;                ///< in capitals: "MODEL"
    WordKind kind = WordKind::text;  ///< what it names
    bool optional = false;           ///< may be left out, with all words after it
    /// WordKind::choice: what it may be; of other kinds: what may stand there instead.
    std::vector<std::string> (*choices)() = nullptr;
};

/// An option of a command: --name, or --name VALUE.
struct CommandOption {
    std::string name;                                 ///< without dashes: "threads"
    std::string value;                                ///< what its value is called: "N"; empty: a switch
    std::string meaning;                              ///< for the help, with the default
    WordKind kind = WordKind::text;                   ///< what the value names
    std::vector<std::string> (*choices)() = nullptr;  ///< WordKind::choice: what it may be
};

/// The words and options of the command line, checked against the command's table row.
struct CommandCall {
    Console console;
    std::string command = {};
    std::vector<std::string> words = {};
    std::map<std::string, std::string> options = {};  ///< given ones by name; switches hold ""

    [[nodiscard]] bool has(const std::string& option) const { return options.count(option) > 0; }
    /// The value of an option, or the default without it.
    [[nodiscard]] std::string value(const std::string& option, std::string_view without) const {
        const auto found = options.find(option);
        return found == options.end() ? std::string(without) : found->second;
    }
    /// The value of an option as an integer.
    /// @throws CommandLineError when it is not an integer, or below `lowest`.
    [[nodiscard]] int whole_number(const std::string& option, int without, int lowest) const;
};

/// An example of a command in its help, man page and tests.
struct CommandExample {
    std::string line;     ///< "orbid run job.json --out out"
    std::string meaning;  ///< what it does; may be empty
};

/// One command of the program: all data for help, completion, man page and parser.
struct Command {
    std::string name;
    std::string summary;  ///< one line
    std::vector<CommandWord> words;
    std::vector<CommandOption> options;  ///< besides those every command has
    std::vector<CommandExample> examples;
    int (*run)(const CommandCall& call) = nullptr;  ///< returns the exit code
    std::string details = {};                       ///< paragraphs for the help below the options; may be empty
};

}  // namespace orbid::apps
