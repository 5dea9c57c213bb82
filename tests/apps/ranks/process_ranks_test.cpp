#include "apps/ranks/process_ranks.hpp"

#include <sys/prctl.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>

#include "estimator/ranks/thread_ranks.hpp"
#include "tests/apps/ranks/rank_exchange.hpp"
#include "tests/catch.hpp"

namespace process_ranks_test {

using namespace orbid::estimator;
using orbid::apps::ProcessRanks;
using rank_exchange::Bytes;
using std::chrono::milliseconds;

template <class T>
Bytes bytes(const T& value) {
    const auto view = std::as_bytes(std::span(&value, 1));
    return {view.begin(), view.end()};
}

template <class T>
T value(const RankMessage& message) {
    T value{};
    REQUIRE_FALSE(message.lost);
    REQUIRE(message.content.size() == sizeof value);
    std::memcpy(&value, message.content.data(), sizeof value);
    return value;
}

/// Says its process number, then waits for ever.
int say_and_wait(Ranks& ranks) {
    ranks.send(0, bytes(::getpid()));
    for (;;)
        (void)ranks.receive(Ranks::any);
}

bool have_children() {
    return ::waitpid(-1, nullptr, WNOHANG) >= 0 || errno != ECHILD;
}

TEST_CASE("Threads pass the exchange of all kinds of ranks", "[ranks]") {
    const int count = GENERATE(1, 2, 3);
    ThreadRanks ranks(count);
    std::vector<std::thread> threads;
    for (int rank = 1; rank < count; ++rank)
        threads.emplace_back([&ranks, rank] {
            CHECK(rank_exchange::follow(ranks[rank]) == 0);
            ranks.end(rank);
        });
    CHECK_NOTHROW(rank_exchange::lead(ranks[0]));
    for (std::thread& thread : threads)
        thread.join();
}

TEST_CASE("Processes pass the exchange of all kinds of ranks, and leave nothing behind", "[ranks]") {
    const int count = GENERATE(1, 2, 3, 4);
    {
        ProcessRanks ranks(count, rank_exchange::follow);
        CHECK(ranks.count() == count);
        CHECK_NOTHROW(rank_exchange::lead(ranks));
        for (int rank = 1; rank < count; ++rank)
            CHECK(ranks.how_ended(rank) == "exit status 0");
    }
    CHECK_FALSE(have_children());
}

TEST_CASE("Processes: signals between all calls change nothing", "[ranks]") {
    struct sigaction handler {};
    struct sigaction former {};
    handler.sa_handler = [](int) {};
    REQUIRE(::sigaction(SIGALRM, &handler, &former) == 0);
    const itimerval often{{0, 700}, {0, 700}};
    REQUIRE(::setitimer(ITIMER_REAL, &often, nullptr) == 0);
    {
        ProcessRanks ranks(3, rank_exchange::follow);
        CHECK_NOTHROW(rank_exchange::lead(ranks));
    }
    const itimerval never{};
    ::setitimer(ITIMER_REAL, &never, nullptr);
    ::sigaction(SIGALRM, &former, nullptr);
}

TEST_CASE("Processes: how each ended is told once, and it starts anew", "[ranks]") {
    ProcessRanks ranks(6, [](Ranks& own) {
        switch (own.rank()) {
            case 1:
                ::raise(SIGSEGV);
                break;
            case 2:
                throw std::runtime_error("no such orbit");
            case 3:
                own.send(0, bytes(33));
                ::_exit(7);
            case 4:
                throw 4;
            default:
                return say_and_wait(own);
        }
        return 0;
    });
    const auto waiting = value<pid_t>(ranks.receive(5));
    CHECK(ranks.how_ended(5).empty());
    REQUIRE(::kill(waiting, SIGKILL) == 0);
    CHECK(value<int>(ranks.receive(3)) == 33);
    std::set<int> lost;
    while (lost.size() < 5) {
        const RankMessage message = ranks.receive(Ranks::any);
        CHECK(message.lost);
        CHECK(lost.insert(message.from).second);
    }
    CHECK(ranks.how_ended(1) == "SIGSEGV");
    CHECK(ranks.how_ended(2) == "exception: no such orbit");
    CHECK(ranks.how_ended(3) == "exit status 7");
    CHECK(ranks.how_ended(4) == "exception: unknown");
    CHECK(ranks.how_ended(5) == "SIGKILL");
    CHECK_FALSE(ranks.receive(Ranks::any, milliseconds(10)));

    ranks.restart(5);
    CHECK(ranks.how_ended(5).empty());
    CHECK(value<pid_t>(ranks.receive(5)) != waiting);
    // A time limit.
    ranks.kill(5);
    CHECK(ranks.receive(5).lost);
    CHECK(ranks.how_ended(5) == "SIGKILL");
    ranks.kill(5);
    CHECK_FALSE(ranks.receive(Ranks::any, milliseconds(10)));
}

TEST_CASE("Processes: one that is killed within a big message is lost; sending to it kills nobody", "[ranks]") {
    ProcessRanks ranks(2, [](Ranks& own) {
        if (own.receive(0).content.size() == 1) ::raise(SIGSTOP);
        own.send(0, Bytes(10'000'000));
        return 0;
    });
    ranks.send(1, Bytes(2));
    // Part of its message is in the socket then.
    ::usleep(20'000);
    CHECK_FALSE(ranks.receive(0, milliseconds(0)));
    ranks.kill(1);
    for (int k = 0; k < 100; ++k)
        ranks.send(1, Bytes(100'000));
    CHECK(ranks.receive(Ranks::any).lost);
    ranks.send(1, Bytes(10));
    CHECK_FALSE(ranks.receive(Ranks::any, milliseconds(10)));

    // One that takes nothing does not hold rank 0 up.
    ranks.restart(1);
    ranks.send(1, Bytes(1));
    ranks.send(1, Bytes(10'000'000));
    CHECK_FALSE(ranks.receive(Ranks::any, milliseconds(50)));
    ranks.kill(1);
    CHECK(ranks.receive(1).lost);
}

TEST_CASE("Processes: the end of rank 0 ends all", "[ranks]") {
    // Those whose parent has ended become children of this process.
    REQUIRE(::prctl(PR_SET_CHILD_SUBREAPER, 1) == 0);
    int pipe_ends[2];
    REQUIRE(::pipe(pipe_ends) == 0);
    const pid_t leader = ::fork();
    if (leader == 0) {
        ProcessRanks ranks(4, [](Ranks& own) {
            own.send(0, bytes(::getpid()));
            for (;;)
                ::pause();
            return 0;
        });
        for (int rank = 1; rank < 4; ++rank) {
            const RankMessage message = ranks.receive(rank);
            if (::write(pipe_ends[1], message.content.data(), sizeof(pid_t)) != sizeof(pid_t)) ::_exit(1);
        }
        for (;;)
            ::pause();
    }
    pid_t children[3];
    for (pid_t& child : children)
        REQUIRE(::read(pipe_ends[0], &child, sizeof child) == sizeof child);
    // What a terminal sends to all at once does not end them.
    for (const pid_t child : children) {
        CHECK(::kill(child, SIGINT) == 0);
        CHECK(::kill(child, SIGTERM) == 0);
    }
    ::usleep(50'000);
    REQUIRE(::kill(leader, SIGKILL) == 0);
    int status = 0;
    CHECK(::waitpid(leader, &status, 0) == leader);
    for (const pid_t child : children) {
        CHECK(::waitpid(child, &status, 0) == child);
        CHECK(WIFSIGNALED(status));
        CHECK(WTERMSIG(status) == SIGKILL);
    }
    ::close(pipe_ends[0]);
    ::close(pipe_ends[1]);
    ::prctl(PR_SET_CHILD_SUBREAPER, 0);
}

TEST_CASE("Processes: the end of ranks kills what still computes, also after an exception", "[ranks]") {
    try {
        const ProcessRanks ranks(3, [](Ranks&) {
            for (;;)
                ::pause();
            return 0;
        });
        throw std::runtime_error("rank 0 fails");
    } catch (const std::runtime_error&) {
    }
    CHECK_FALSE(have_children());
}

TEST_CASE("Processes: what rank 0 has not yet written is written once", "[ranks]") {
    char plain_name[] = "/tmp/ranks_XXXXXX", stream_name[] = "/tmp/ranks_XXXXXX";
    ::close(::mkstemp(plain_name));
    ::close(::mkstemp(stream_name));
    std::FILE* const plain = std::fopen(plain_name, "w");
    std::ofstream stream(stream_name);
    std::fputs("once", plain);
    stream << "once";
    {
        ProcessRanks ranks(3, [](Ranks& own) { return own.rank() == 1 ? throw std::runtime_error("") : 0; });
        CHECK(ranks.receive(1).lost);
        CHECK(ranks.receive(2).lost);
    }
    std::fclose(plain);
    stream.close();
    for (const char* name : {plain_name, stream_name}) {
        std::ifstream file(name);
        CHECK(std::string(std::istreambuf_iterator<char>(file), {}) == "once");
        ::unlink(name);
    }
}

TEST_CASE("Processes: wrong calls name what is wrong", "[ranks]") {
    CHECK_THROWS_AS(ProcessRanks(0, rank_exchange::follow), std::invalid_argument);
    ProcessRanks ranks(3, [](Ranks& own) {
        if (own.rank() == 1) own.send(2, {});
        return say_and_wait(own);
    });
    CHECK(ranks.receive(1).lost);
    CHECK(ranks.how_ended(1) == "exception: rank 1 sends to rank 2: processes exchange messages with rank 0 alone");
    CHECK_THROWS_AS(ranks.send(3, {}), std::out_of_range);
    CHECK_THROWS_AS(ranks.how_ended(0), std::out_of_range);
    CHECK_THROWS_AS(ranks.restart(2), std::logic_error);
    std::thread other([] { ::usleep(200'000); });
    CHECK_THROWS_AS(ranks.restart(1), std::logic_error);
    other.join();
    CHECK_NOTHROW(ranks.restart(1));
}

}  // namespace process_ranks_test
