#include "apps/program/command_table.hpp"

#include <utility>

#include "apps/program/colour.hpp"
#include "apps/program/command_campaign.hpp"
#include "apps/program/command_completion.hpp"
#include "apps/program/command_help.hpp"
#include "apps/program/command_model.hpp"
#include "apps/program/command_run.hpp"
#include "apps/program/command_schema.hpp"
#include "apps/program/command_stored.hpp"
#include "apps/program/manual_page.hpp"
#include "apps/program/starting/model_listing.hpp"
#include "apps/report/plots/plot_catalog.hpp"

namespace orbid::apps {

namespace {

const CommandWord job_word{"JOB.json", WordKind::job_file};

const std::vector<CommandOption>& run_options() {
    static const std::vector<CommandOption> all{
        {"out", "DIR", "folder of the results (default: the job's path without .json)", WordKind::folder},
        {"threads", "N", "threads (default 0: all cores); results do not depend on it", WordKind::number},
        {"quiet", "", "no progress on standard error"},
        {"progress", "SECONDS", "without a terminal: longest time between two lines about a stage (default 10)",
         WordKind::number},
        {"force", "", "overwrite a folder that holds the result of another job"}};
    return all;
}

/// A command that runs all stages of a job or one.
Command job_command(std::string name, std::string summary, CommandExample example,
                    int (*run)(const CommandCall& call)) {
    return {std::move(name), std::move(summary), {job_word}, run_options(), {std::move(example)}, run};
}

std::vector<Command> job_commands() {
    return {
        job_command("run", "all stages the job names",
                    {"orbid run configs/pendulum_table3.json --out out", "results in out/"}, run_all_stages),
        job_command("simulate", "make the data only", {"orbid simulate job.json", ""}, run_simulation),
        job_command("orbits", "find the periodic orbits in the data", {"orbid orbits job.json", ""}, run_orbits),
        job_command("periodic", "compute, search for and follow periodic orbits of the model",
                    {"orbid periodic configs/pendulum_cascade.json --out out", ""}, run_periodic),
        job_command("estimate", "estimate the parameters", {"orbid estimate job.json --threads 2", ""}, run_estimation),
        Command{
            "check",
            "every error of a job or campaign; what it would run and take",
            {job_word},
            {{"threads", "N", "threads that the estimate of the work is for (default 0: all cores)", WordKind::number},
             {"flow", "", "compare flows and derivatives by both steppers: \"verner\" and \"odeint\""}},
            {{"orbid check job.json", ""}, {"orbid check job.json --flow", "are the integrator's numbers right?"}},
            check_job},
        Command{"models",
                "the models, or one of them",
                {{"NAME", WordKind::choice, true, model_names}},
                {},
                {{"orbid models parametric_pendulum", ""}},
                show_models},
        Command{"new",
                "print a commented starting job or campaign",
                {{"MODEL", WordKind::choice, false, starting_subjects},
                 {"TASK", WordKind::choice, true, starting_purposes}},
                {},
                {{"orbid new parametric_pendulum cycles > job.json", ""},
                 {"orbid new equations series > job.json", "a model written in the job itself"},
                 {"orbid new campaign coverage > campaign.json", "many runs of one job"}},
                show_starting_job,
                "After a model, TASK is simulate to continuation; after campaign, sweep to\nrecords."}};
}

std::vector<Command> campaign_commands() {
    return {
        Command{"campaign",
                "many runs with one journal, resumable",
                {{"CAMPAIGN.json", WordKind::job_file, false, campaign_verbs}, {"DIR", WordKind::folder, true}},
                {{"out", "DIR",
                  "folder of the journal (default: the campaign's path without .json); of export: file of the table",
                  WordKind::folder},
                 {"threads", "N", "tasks at the same time (default 0: one per core)", WordKind::number},
                 {"engine", "NAME", "who computes (default auto: ranks of MPI, else processes)", WordKind::choice,
                  engine_choices},
                 {"quiet", "", "no progress on standard error"},
                 {"progress", "SECONDS", "without a terminal: time between two lines (default 10)", WordKind::number},
                 {"status", "WORD", "of retry: only tasks that failed so (crash, data, error, invalid, time_limit)"},
                 {"table", "NAME", "of export: which table (default tasks)", WordKind::choice, campaign_table_choices},
                 {"times", "", "of export: also attempts, host, rank and times"},
                 {"job", "N", "of export: the job of task N, to run it alone", WordKind::number},
                 {"result", "N", "of export: the result.json of task N", WordKind::number}},
                {{"orbid campaign coverage.json --out out", "out/campaign.sqlite; the same command goes on"},
                 {"orbid campaign status out", "how far it is, and what failed"},
                 {"orbid campaign retry out --status crash", "failed tasks once more"},
                 {"orbid campaign export out --table summary", "CSV"},
                 {"orbid campaign report out", "out/report.html"},
                 {"mpiexec -n 64 orbid campaign coverage.json", "on a cluster"}},
                run_campaign_command,
                "In the place of CAMPAIGN.json: status, retry, export or report, followed by DIR,\nthe folder of a "
                "campaign."}};
}

std::vector<Command> result_commands() {
    return {Command{"report",
                    "write report.html of an output folder anew",
                    {{"DIR", WordKind::folder}},
                    {},
                    {{"orbid report out", "out/report.html, one page that needs no network"}},
                    write_report},
            Command{"plot",
                    "the plots of a stored run, at the size and in the formats of papers",
                    {{"DIR", WordKind::folder}, {"NAME", WordKind::choice, true, plot_names}},
                    {{"format", "TYPE", "svg, pdf or png (default: as --out ends, else svg)", WordKind::choice,
                      plot_formats},
                     {"out", "FILE", "where to (default DIR/plot_NAME.TYPE; \"-\": standard output)", WordKind::file},
                     {"width", "MM", "width of the page in mm (default 88: one column)", WordKind::number},
                     {"font", "PT", "size of numbers and labels in pt (default 8)", WordKind::number},
                     {"dpi", "N", "dots per inch of png (default 300)", WordKind::number},
                     {"title", "", "with the run's title above"}},
                    {{"orbid plot out", "which plots there are"},
                     {"orbid plot out section --format pdf --width 180", "out/plot_section.pdf, as wide as a page"}},
                    plot_run}};
}

std::vector<Command> help_commands() {
    return {Command{"completion",
                    "print a script that teaches a shell commands and options",
                    {{"SHELL", WordKind::choice, false, completion_shells}},
                    {},
                    {{"orbid completion bash > ~/.local/share/bash-completion/completions/orbid", "for every new bash"},
                     {"source <(orbid completion bash)", "for this one"},
                     {"orbid completion zsh > \"${fpath[1]}/_orbid\"", "for every new zsh"}},
                    show_completion},
            Command{"man",
                    "print the manual page orbid(1)",
                    {},
                    {},
                    {{"orbid man | man -l -", "reads it"},
                     {"orbid man > ~/.local/share/man/man1/orbid.1", "for `man orbid`"}},
                    show_manual_page},
            Command{"help",
                    "this overview, or the help of a command",
                    {{"COMMAND", WordKind::choice, true, command_names}},
                    {},
                    {{"orbid help run", ""}},
                    show_help},
            Command{"schema",
                    "print the JSON Schema of jobs or campaigns, for editors",
                    {},
                    {{"campaign", "", "of campaigns"}, {"markdown", "", "all keys as a page instead"}},
                    {{"orbid schema > orbid-job.schema.json", "what a job's \"$schema\" may name"},
                     {"orbid schema --campaign > orbid-campaign.schema.json", "what that of a campaign may name"}},
                    show_schema}};
}

std::vector<Command> comparing_commands() {
    return {
        Command{
            "predict",
            "predict a further record, or periodic motions, from a stored run",
            {{"DIR", WordKind::folder}, {"DATA", WordKind::file}},
            {{"out", "DIR", "folder of the prediction (default DIR/predict_NAME)", WordKind::folder},
             {"experiment", "NAME", "experiment of the run that the record is like (default: the only one)"},
             {"inputs", "FILE", "table of the measured inputs, where those of the run have a table of their own",
              WordKind::file},
             {"quiet", "", "no progress on standard error"},
             {"threads", "N", "threads (default 0: all cores); results do not depend on it", WordKind::number},
             {"force", "", "overwrite a folder that holds the result of another job"}},
            {{"orbid predict out further.csv", "errors over the record, and how far ahead they stay within 2 sds"},
             {"orbid predict out question.json", "orbits and branches at other parameters, stable or not, with bands"}},
            predict_run,
            "DATA is a table or HDF5 file in the layout of the run's data, or a JSON\nfile with one \"data\" object. "
            "JSON with \"periodic\" or \"measured\" is a question\non periodic motions."},
        Command{"compare",
                "two stored runs beside each other",
                {{"DIR", WordKind::folder}, {"DIR2", WordKind::folder}},
                {},
                {{"orbid compare out other", "parameters in sds of their difference, error scales, jobs, cycles"}},
                compare_runs}};
}

}  // namespace

const std::vector<CommandOption>& common_options() {
    static const std::vector<CommandOption> all{
        {"color", "WHEN", "colours on a terminal (default auto)", WordKind::choice, colour_choices},
        {"help", "", "this text"}};
    return all;
}

std::vector<CommandOption> all_options(const Command& command) {
    std::vector<CommandOption> all = command.options;
    all.insert(all.end(), common_options().begin(), common_options().end());
    return all;
}

const std::vector<Command>& command_table() {
    static const std::vector<Command> all = [] {
        std::vector<Command> list;
        for (const auto& group :
             {job_commands(), campaign_commands(), result_commands(), help_commands(), comparing_commands()})
            list.insert(list.end(), group.begin(), group.end());
        return list;
    }();
    return all;
}

}  // namespace orbid::apps
