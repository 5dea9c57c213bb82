#include "apps/program/problem_list.hpp"

namespace orbid::apps {

std::vector<JobProblem> problem_list(const std::vector<Problem>& problems, const std::filesystem::path& source) {
    std::vector<JobProblem> list;
    for (const Problem& problem : problems)
        list.push_back({problem.pointer, problem.place.line, problem.place.column, problem.rule,
                        problem.kind == Problem::Kind::data, message(problem, source.string())});
    return list;
}

}  // namespace orbid::apps
