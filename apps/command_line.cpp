#include "apps/command_line.hpp"

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <optional>
#include <sstream>
#include <stdexcept>

#include <fmt/format.h>
#include <boost/program_options.hpp>

#include "apps/job_reader.hpp"
#include "apps/job_summary.hpp"
#include "apps/json_reader.hpp"
#include "apps/model_listing.hpp"
#include "apps/run.hpp"
#include "apps/starting_job.hpp"
#include "apps/version.hpp"

namespace orbid::apps {

namespace {

namespace options = boost::program_options;

constexpr int wrong_command_line = 2;

struct Command {
    std::string name;
    std::string usage;
    std::string summary;
    std::string example;
    std::optional<Stage> stage;
    bool later = false;
};

const std::vector<Command>& commands() {
    static const std::vector<Command> all{
        {"run", "JOB.json", "all stages the job names", "orbid run configs/pendulum_table3.json --out out", Stage::all},
        {"simulate", "JOB.json", "make the data only", "orbid simulate job.json", Stage::simulate},
        {"orbits", "JOB.json", "find the periodic orbits in the data", "orbid orbits job.json", Stage::orbits},
        {"periodic", "JOB.json", "compute, search for and follow periodic orbits of the model",
         "orbid periodic configs/pendulum_cascade.json --out out", Stage::periodic},
        {"estimate", "JOB.json", "estimate the parameters", "orbid estimate job.json --threads 2", Stage::estimate},
        {"check", "JOB.json", "every error of a job, and what it would run", "orbid check job.json", {}},
        {"models", "[NAME]", "the models, or one of them", "orbid models parametric_pendulum", {}},
        {"new",
         "MODEL [TASK]",
         "print a commented starting job; TASK: simulate (default), cycles, series, waveform, periodic, search, "
         "continuation",
         "orbid new parametric_pendulum cycles > job.json",
         {}},
        {"report", "", "", "", {}, true},
        {"plot", "", "", "", {}, true},
        {"schema", "", "", "", {}, true},
        {"predict", "", "", "", {}, true},
        {"compare", "", "", "", {}, true}};
    return all;
}

/// The command line cannot be understood; the message says why.
class CommandLineError : public std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

options::options_description command_options(const Command& command) {
    options::options_description list("options");
    auto add = list.add_options();
    add("help,h", "this text");
    if (command.stage) {
        add("out", options::value<std::string>(), "folder of the results (default: the job's path without .json)");
        add("threads", options::value<int>()->default_value(0), "threads (0: all cores); results do not depend on it");
        add("quiet", "no progress on standard error");
        add("force", "overwrite a folder that holds the result of another job");
    }
    return list;
}

std::string program_help() {
    std::string text = "orbid: parameters of nonlinear systems from chaotic data\n\nusage: orbid COMMAND [options]\n\n";
    for (const Command& command : commands()) {
        if (!command.later) text += fmt::format("  {:<9} {:<13} {}\n", command.name, command.usage, command.summary);
    }
    return text +
           "\n  --version, --help, COMMAND --help\n\n"
           "exit codes: 0 done; 1 done, but no valid answer; 2 wrong command line or job; 3 data cannot be used;\n"
           "            4 internal error; 130 interrupted\n";
}

std::string command_help(const Command& command) {
    std::ostringstream list;
    list << command_options(command);
    return fmt::format("orbid {} {}: {}\n\n{}\nexample: {}\n", command.name, command.usage, command.summary, list.str(),
                       command.example);
}

struct Parsed {
    options::variables_map values;
    std::vector<std::string> words;
};

Parsed parse(const Command& command, const std::vector<std::string>& arguments) {
    options::options_description all = command_options(command);
    all.add_options()("words", options::value<std::vector<std::string>>(), "");
    options::positional_options_description positions;
    positions.add("words", -1);
    Parsed parsed;
    try {
        // No guessing of shortened names: a later option must not change what an old script means.
        const auto style = options::command_line_style::default_style & ~options::command_line_style::allow_guessing;
        options::store(options::command_line_parser(arguments).options(all).positional(positions).style(style).run(),
                       parsed.values);
        options::notify(parsed.values);
    } catch (const options::error& error) {
        throw CommandLineError(fmt::format("orbid {}: {}", command.name, error.what()));
    }
    if (parsed.values.count("words") > 0) parsed.words = parsed.values["words"].as<std::vector<std::string>>();
    return parsed;
}

void need_words(const Command& command, const std::vector<std::string>& words, std::size_t lowest,
                std::size_t highest) {
    if (words.size() >= lowest && words.size() <= highest) return;
    throw CommandLineError(fmt::format("orbid {} takes {}, not {} arguments; see orbid {} --help", command.name,
                                       command.usage, words.size(), command.name));
}

/// The job, or its problems on standard error.
JobReading read_and_report(const std::string& file) {
    JobReading reading = read_job_file(file);
    for (const Problem& problem : reading.problems)
        std::cerr << message(problem, file) << '\n';
    return reading;
}

int run_stages(const Command& command, const Parsed& parsed) {
    need_words(command, parsed.words, 1, 1);
    RunOptions run;
    run.stage = *command.stage;
    run.threads = parsed.values["threads"].as<int>();
    if (run.threads < 0) throw CommandLineError(fmt::format("--threads must be >= 0, not {}", run.threads));
    run.quiet = parsed.values.count("quiet") > 0;
    run.force = parsed.values.count("force") > 0;
    const JobReading reading = read_and_report(parsed.words[0]);
    if (!reading.job) return reading.exit_code();
    std::filesystem::path out = parsed.words[0];
    if (out.extension() == ".json")
        out.replace_extension();
    else
        out += ".out";  // a job without .json must not be its own folder
    run.out = parsed.values.count("out") > 0 ? std::filesystem::path(parsed.values["out"].as<std::string>()) : out;
    return run_job(*reading.job, run);
}

int check(const Command& command, const Parsed& parsed) {
    need_words(command, parsed.words, 1, 1);
    const JobReading reading = read_and_report(parsed.words[0]);
    if (reading.job) std::cout << job_summary(*reading.job);
    return reading.exit_code();
}

int show_models(const Command& command, const Parsed& parsed) {
    need_words(command, parsed.words, 0, 1);
    if (parsed.words.empty()) {
        std::cout << model_list();
        return 0;
    }
    const auto names = model_names();
    if (std::find(names.begin(), names.end(), parsed.words[0]) == names.end()) {
        throw CommandLineError(
            fmt::format("there is no model \"{}\"{}", parsed.words[0], suggestion(parsed.words[0], names)));
    }
    std::cout << model_page(parsed.words[0]);
    return 0;
}

int show_new(const Command& command, const Parsed& parsed) {
    need_words(command, parsed.words, 1, 2);
    try {
        std::cout << starting_job(parsed.words[0], parsed.words.size() > 1 ? parsed.words[1] : "simulate");
    } catch (const std::invalid_argument& error) {
        throw CommandLineError(error.what());
    }
    return 0;
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
    for (const Command& command : commands()) {
        if (!command.later) names.push_back(command.name);
        if (command.name != first) continue;
        if (command.later) throw CommandLineError(fmt::format("orbid {}: {}", first, not_in_this_version));
        const Parsed parsed = parse(command, {arguments.begin() + 1, arguments.end()});
        if (parsed.values.count("help") > 0) {
            std::cout << command_help(command);
            return 0;
        }
        if (command.stage) return run_stages(command, parsed);
        if (command.name == "check") return check(command, parsed);
        if (command.name == "models") return show_models(command, parsed);
        return show_new(command, parsed);
    }
    throw CommandLineError(fmt::format("there is no command \"{}\"{}", first, suggestion(first, names)));
}

}  // namespace

int run_command(const std::vector<std::string>& arguments) {
    try {
        return run_known(arguments);
    } catch (const CommandLineError& error) {
        std::cerr << error.what() << '\n';
        return wrong_command_line;
    }
}

}  // namespace orbid::apps
