#include "apps/command_table.hpp"

#include "apps/command_model.hpp"
#include "apps/command_run.hpp"
#include "apps/model_listing.hpp"
#include "apps/starting_job.hpp"

namespace orbid::apps {

namespace {

std::vector<std::string> task_names() {
    return starting_tasks();
}

const CommandWord job_word{"JOB.json", WordKind::job_file};

const std::vector<CommandOption>& run_options() {
    static const std::vector<CommandOption> all{
        {"out", "DIR", "folder of the results (default: the job's path without .json)", WordKind::folder},
        {"threads", "N", "threads (default 0: all cores); results do not depend on it", WordKind::number},
        {"quiet", "", "no progress on standard error"},
        {"force", "", "overwrite a folder that holds the result of another job"}};
    return all;
}

}  // namespace

const std::vector<CommandOption>& common_options() {
    static const std::vector<CommandOption> all{{"help", "", "this text"}};
    return all;
}

const std::vector<Command>& command_table() {
    static const std::vector<Command> all{
        {"run",
         "all stages the job names",
         {job_word},
         run_options(),
         {{"orbid run configs/pendulum_table3.json --out out", "results in out/"}},
         "",
         run_all_stages},
        {"simulate",
         "make the data only",
         {job_word},
         run_options(),
         {{"orbid simulate job.json", ""}},
         "",
         run_simulation},
        {"orbits",
         "find the periodic orbits in the data",
         {job_word},
         run_options(),
         {{"orbid orbits job.json", ""}},
         "",
         run_orbits},
        {"periodic",
         "compute, search for and follow periodic orbits of the model",
         {job_word},
         run_options(),
         {{"orbid periodic configs/pendulum_cascade.json --out out", ""}},
         "",
         run_periodic},
        {"estimate",
         "estimate the parameters",
         {job_word},
         run_options(),
         {{"orbid estimate job.json --threads 2", ""}},
         "",
         run_estimation},
        {"check",
         "every error of a job, and what it would run",
         {job_word},
         {},
         {{"orbid check job.json", ""}},
         "",
         check_job},
        {"models",
         "the models, or one of them",
         {{"NAME", WordKind::choice, true, model_names}},
         {},
         {{"orbid models parametric_pendulum", ""}},
         "",
         show_models},
        {"new",
         "print a commented starting job",
         {{"MODEL", WordKind::choice, false, model_names}, {"TASK", WordKind::choice, true, task_names}},
         {},
         {{"orbid new parametric_pendulum cycles > job.json", ""}},
         "",
         show_starting_job},
        {"report", "", {}, {}, {}, ""},
        {"plot", "", {}, {}, {}, ""},
        {"schema", "", {}, {}, {}, ""},
        {"predict", "", {}, {}, {}, ""},
        {"compare", "", {}, {}, {}, ""}};
    return all;
}

}  // namespace orbid::apps
