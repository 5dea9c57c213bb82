#include "apps/program/command_line.hpp"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <new>
#include <ostream>

#include <fmt/format.h>
#include <boost/program_options.hpp>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/json_reader.hpp"
#include "apps/documents/memory_limit.hpp"
#include "apps/documents/printable.hpp"
#include "apps/job/version.hpp"
#include "apps/program/colour.hpp"
#include "apps/program/command_help.hpp"
#include "apps/program/command_table.hpp"
#include "models/system/processor_level.hpp"

namespace orbid::apps {

namespace {

namespace options = boost::program_options;

options::options_description description(const std::vector<CommandOption>& all) {
    options::options_description list;
    for (const CommandOption& option : all) {
        const std::string name = option.name == "help" ? "help,h" : option.name;
        if (option.value.empty()) {
            list.add_options()(name.c_str(), "");
        } else {
            list.add_options()(name.c_str(), options::value<std::string>(), "");
        }
    }
    list.add_options()("words", options::value<std::vector<std::string>>(), "");
    return list;
}

/// Words and options of one command. Names of options are written in full: a later option must not change what an old
/// script means.
CommandCall parsed(const Command& command, const std::vector<std::string>& arguments, const Console& console) {
    const auto refuse = [&command](const std::string& reason) {
        throw CommandLineError(fmt::format("orbid {}: {}", command.name, reason));
    };
    const std::vector<CommandOption> all = all_options(command);
    const options::options_description list = description(all);
    options::positional_options_description positions;
    positions.add("words", -1);
    options::variables_map values;
    try {
        const auto style = options::command_line_style::default_style & ~options::command_line_style::allow_guessing;
        options::store(options::command_line_parser(arguments).options(list).positional(positions).style(style).run(),
                       values);
    } catch (const options::unknown_option& error) {
        std::vector<std::string> names;
        for (const CommandOption& option : all)
            names.push_back("--" + option.name);
        refuse(fmt::format("there is no option \"{}\"{}", error.get_option_name(),
                           suggestion(error.get_option_name(), names)));
    } catch (const options::error& error) {
        refuse(error.what());
    }
    CommandCall call{console};
    call.command = command.name;
    if (values.count("words") > 0) call.words = values["words"].as<std::vector<std::string>>();
    for (const CommandOption& option : all) {
        if (values.count(option.name) == 0) continue;
        const std::string value = option.value.empty() ? "" : values[option.name].as<std::string>();
        if (option.choices != nullptr) {
            const auto choices = option.choices();
            if (std::find(choices.begin(), choices.end(), value) == choices.end())
                refuse(fmt::format("--{} must be one of {}, not \"{}\"", option.name, fmt::join(choices, ", "), value));
        }
        call.options[option.name] = value;
    }
    return call;
}

void need_words(const Command& command, const CommandCall& call) {
    const auto needed = std::count_if(command.words.begin(), command.words.end(),
                                      [](const CommandWord& word) { return !word.optional; });
    if (call.words.size() >= static_cast<std::size_t>(needed) && call.words.size() <= command.words.size()) return;
    throw CommandLineError(fmt::format("orbid {} takes {}, not {} argument{}; see orbid {} --help", command.name,
                                       command.words.empty() ? "no arguments" : usage_words(command), call.words.size(),
                                       call.words.size() == 1 ? "" : "s", command.name));
}

int run_known(const std::vector<std::string>& arguments, const Console& console) {
    if (arguments.empty()) throw CommandLineError(program_help());
    const std::string& first = arguments.front();
    if (first == "--help" || first == "-h") {
        console.out << program_help();
        return 0;
    }
    if (first == "--version") {
        console.out << "orbid " << program_version();
        if (const std::string_view level = models::processor_level(); !level.empty())
            console.out << " (" << level << ')';
        console.out << '\n';
        return 0;
    }
    for (const Command& command : command_table()) {
        if (command.name != first) continue;
        CommandCall call = parsed(command, {arguments.begin() + 1, arguments.end()}, console);
        if (call.has("help")) {
            console.out << command_help(command);
            return 0;
        }
        need_words(command, call);
        return command.run(call);
    }
    throw CommandLineError(fmt::format("there is no command \"{}\"{}", first, suggestion(first, command_names())));
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

int run_command(const std::vector<std::string>& arguments, const Console& raw) {
    PrintableStream out(raw.out);
    PrintableStream errors(raw.error);
    const Console console{out, errors, raw.out_terminal, raw.error_terminal, raw.signals, raw.own_process, raw.stopped};
    try {
        return run_known(arguments, console);
    } catch (const CommandLineError& error) {
        write_unfiltered(console.error, error_text(error.what(), is_coloured("auto", console.error_terminal)) + '\n');
        return wrong_call;
    } catch (const std::filesystem::filesystem_error& error) {
        // A path that the system refuses: too long, in a folder that may not be searched, links in a circle.
        console.error << fmt::format("{}: {}\n", error.path1().string(), error.code().message());
        return unusable_data;
    } catch (const FileUnreadable& error) {
        write_unfiltered(console.error, error_text(error.what(), is_coloured("auto", console.error_terminal)) + '\n');
        return unusable_data;
    } catch (const FileNotWritten& error) {
        write_unfiltered(console.error, error_text(error.what(), is_coloured("auto", console.error_terminal)) + '\n');
        return not_stored;
    } catch (const std::bad_alloc&) {
        console.error << out_of_memory_text() << '\n';
        if (!console.error) throw;  // not even for that: the caller's turn
        return out_of_memory;
    }
}

int run_command(const std::vector<std::string>& arguments, bool own_process) {
    return run_command(arguments, standard_console(own_process));
}

int run_command(const std::vector<std::string>& arguments, std::ostream& out, std::ostream& error,
                const std::function<bool()>& stopped) {
    Console console{out, error};
    console.stopped = stopped;
    return run_command(arguments, console);
}

}  // namespace orbid::apps
