// What does it cost to deal tasks and to keep a journal of them?
//
//   campaign_bench [TASKS] [MILLISECONDS] [RANKS]    threads and processes, tasks that compute for so long
//
// Peer: the same tasks in a loop without dealing or journal. Each task takes its job, as orbid's do, and gives a
// result.json of 4 kB.

#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <fmt/format.h>

#include "apps/campaign/engine/campaign_run.hpp"
#include "apps/campaign/plan/campaign_tasks.hpp"

using namespace orbid;

namespace {

double now() {
    using clock = std::chrono::steady_clock;
    return std::chrono::duration<double>(clock::now().time_since_epoch()).count();
}

apps::CampaignTasks made_tasks(std::int64_t count) {
    apps::Campaign campaign;
    campaign.jobs.push_back({"", R"({ "model": { "name": "henon", "parameters": { "a": 1.4, "b": 0.3 } },
      "data": { "simulate": { "sections": 60, "initial": [[0.1, 0.1]], "noise": { "x": 0.01, "y": 0.003 } } },
      "estimate": { "parameters": { "a": { "start": 1.3 }, "b": { "start": 0.3 } },
                    "residuals": [ { "type": "series" } ] } })",
                             "/job.json"});
    campaign.replicates = count;
    campaign.seeded = true;
    return apps::CampaignTasks(campaign);
}

/// Of this process [s].
double processor_time() {
    rusage used{};
    ::getrusage(RUSAGE_SELF, &used);
    return static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
           1e-6 * static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
}

std::string made_result() {
    std::string list;
    for (int i = 0; i < 300; ++i)
        list += fmt::format("{}{}", i > 0 ? "," : "", 1.0 / (i + 3));
    return fmt::format(R"({{"status": "converged", "message": "made", "objective": 1.5, "parameters": {{
      "a": {{"value": 1.4, "sd": 0.1, "interval95": [1.2, 1.6]}}, "b": {{"value": 0.3, "sd": 0.1, "interval95": [0.1, 0.5]}}
      }}, "history": [{}]}})",
                       list);
}

void compute_for(double seconds) {
    for (const double end = now() + seconds; now() < end;) {
    }
}

}  // namespace

int main(int count, char** arguments) {
    const std::int64_t tasks_wanted = count > 1 ? std::atoll(arguments[1]) : 2000;
    const double seconds = count > 2 ? 1e-3 * std::atof(arguments[2]) : 1e-3;
    const int ranks = count > 3 ? std::atoi(arguments[3]) : 2;
    const apps::CampaignTasks tasks = made_tasks(tasks_wanted);
    const std::string result = made_result();
    const apps::TaskRunner runner = [&](const std::string&, const auto&, const auto&) {
        compute_for(seconds);
        apps::TaskRun run;
        run.result = result;
        return run;
    };
    std::printf("%lld tasks of %g ms on %d ranks\n", static_cast<long long>(tasks_wanted), 1e3 * seconds, ranks);
    const auto folder = std::filesystem::temp_directory_path() / fmt::format("orbid_campaign_bench_{}", ::getpid());
    // Processes first: they are forked, which a program that has had threads should not do.
    for (const auto& [name, engine] :
         {std::pair{"processes", apps::Engine::processes}, {"threads", apps::Engine::threads}}) {
        std::filesystem::remove_all(folder);
        const double begin = now();
        apps::Journal journal = apps::campaign_journal(tasks, folder);
        const double made = now();
        const double processor = processor_time();
        apps::CampaignOptions options;
        options.ranks = ranks;
        options.engine = engine;
        if (!apps::run_campaign(tasks, journal, options, runner, {})) return 1;
        const double wall = now() - made;
        const double ideal = static_cast<double>(tasks_wanted) * seconds / ranks;
        std::printf("%-10s journal made in %.2f s; run in %.2f s: %.0f tasks/s", name, made - begin, wall,
                    static_cast<double>(tasks_wanted) / wall);
        std::printf("; %.3f ms more than its own time per task",
                    1e3 * (wall - ideal) * ranks / static_cast<double>(tasks_wanted));
        if (engine == apps::Engine::processes)
            std::printf("; rank 0: %.3f ms of processor",
                        1e3 * (processor_time() - processor) / static_cast<double>(tasks_wanted));
        std::printf("\n");
    }
    std::filesystem::remove_all(folder);
    return 0;
}
