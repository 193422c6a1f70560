// Proof of readout.sv for any tallies, weights, and numbers of classes and populations: the score of a class is the
// sum of weight * tally over the populations, every class has one score, and the first of those with the most wins.
//
// A product is the sum of the tally, shifted, over the bits of the weight. Tallies and weights may be anything
// (any_memory.sv); that the right word is read is proved, how tallies come about is not. Yosys, when `flatten`
// dissolves the module, connects wires with the attribute hierconn to those of the module that have their names.
module readout_proof (
    input logic               clk,
    input logic               clear,
    input logic               load_weight,
    input logic               from_here,
    input logic               after_here,
    input logic               sweep,
    input logic               early_read,
    input logic               read_out,
    input logic               by_potential,
    input logic               fired,
    input logic signed [23:0] potential,
    input logic               start
);
    localparam logic [2:0] IDLE = 0, READ = 1, LOAD = 2, MULTIPLY = 3, COMPARE = 4, DECIDE = 5;
    (* anyconst *) logic [23:0] classes;
    (* anyconst *) logic [23:0] populations;
    wire               done, score_valid;
    wire [15:0]        winner;
    wire signed [63:0] score;
    readout #(.ENTRIES(128)) dut (
        .clk, .clear, .load_weight, .load_address(24'b0), .load_data(128'b0), .classes, .populations, .from_here, .after_here,
        .sweep, .sweep_address(7'b0), .early_read, .early_entry(7'b0), .read_out, .by_potential, .entry(7'b0), .fired,
        .potential, .start, .done, .winner, .score_valid, .score
    );
    (* hierconn *) wire [2:0]         \dut.state ;
    (* hierconn *) wire [6:0]         \dut.address ;
    (* hierconn *) wire [6:0]         \dut.population ;
    (* hierconn *) wire [7:0]         \dut.class_number ;
    (* hierconn *) wire signed [23:0] \dut.stored ;
    (* hierconn *) wire [32:0]        \dut.weight ;
    (* hierconn *) wire [31:0]        \dut.factor ;
    (* hierconn *) wire               \dut.negative ;
    (* hierconn *) wire [63:0]        \dut.addend ;
    (* hierconn *) wire signed [63:0] \dut.best ;
    (* hierconn *) wire               \dut.better ;

    // The model: it follows the module from word to word, and computes scores and the best class of its own.
    logic               running = 0;
    logic [23:0]        class_at, population_at;  // the class and the population whose product is being added
    logic signed [63:0] sum, top;                 // the score of this class so far, and the highest of the classes before
    logic [15:0]        first;                    // the first class that has the highest score
    logic signed [63:0] tally;
    logic [32:0]        weight;                   // sign and magnitude
    logic [5:0]         place;                    // the bit of the magnitude that comes next
    logic [6:0]         tally_at;                 // class_at + population_at * classes
    wire                over = (weight[31:0] >> place) == 0;
    wire                better = class_at == 0 || sum > top;
    wire                scored = \dut.state == COMPARE || \dut.state == DECIDE;

    always_ff @(posedge clk) begin
        if (start) begin
            running <= classes != 0;
            {class_at, population_at, tally_at, sum, first} <= 0;
        end
        if ( \dut.state == LOAD) begin
            tally <= {{40{ \dut.stored [23]}}, \dut.stored };
            weight <= \dut.weight ;
            place <= 0;
        end
        if ( \dut.state == MULTIPLY && !over) begin
            if (weight[place]) sum <= weight[32] ? sum - (tally <<< place) : sum + (tally <<< place);
            place <= place + 1;
        end
        if ( \dut.state == MULTIPLY && over && population_at + 1 != populations) begin
            population_at <= population_at + 1;
            tally_at <= tally_at + classes[6:0];
        end
        if ( \dut.state == DECIDE) begin
            {population_at, sum} <= 0;
            class_at <= class_at + 1;
            tally_at <= class_at[6:0] + 1;
            if (better) {top, first} <= {sum, class_at[15:0]};
            if (class_at + 1 == classes) running <= 0;
        end
        if (clear) running <= 0;
    end

    logic begun = 0, was_clear = 1, was_running = 0;
    always_ff @(posedge clk) begin
        if (clear) begun <= 1;
        {was_clear, was_running} <= {clear, running};
    end
    always_comb begin
        if (!begun) assume (clear);
        assume (classes <= 128 && populations > 0 && populations <= 64);
        if (running) assume (!start && !sweep && !early_read && !read_out && !load_weight);
        if (begun) begin
            // The class, when all scores are known.
            if (done) assert (classes == 0 ? winner == 0 : winner == first && class_at == classes);
            if (!was_clear && was_running && !running) assert (done);
            // A score, and that it is of all populations.
            if (score_valid) assert (score == sum && over && population_at + 1 == populations);
            // The words that are read.
            if ( \dut.state == READ) assert ( \dut.population == population_at);
            if ( \dut.state == READ || \dut.state == LOAD) assert ( \dut.address == tally_at);
            // For induction: what the module remembers.
            assert (running == ( \dut.state != IDLE) && \dut.state <= DECIDE);
            if (running) begin
                assert (class_at < classes && population_at < populations);
                assert ( \dut.class_number == class_at);
                if (class_at != 0) assert ( \dut.best == top && winner == first);
                else assert (winner == 0 && first == 0);
                assert ( \dut.population == population_at + (scored ? 24'd1 : 24'd0));
                assert ( \dut.address == tally_at + (scored ? classes[6:0] : 7'd0));
                assert (score == sum);
            end
            if (scored) assert (over && population_at + 1 == populations);
            if ( \dut.state == DECIDE) assert ( \dut.better == better);
            if ( \dut.state == MULTIPLY) begin
                assert ( \dut.negative == weight[32] && place <= 32);
                assert ( \dut.factor == weight[31:0] >> place);
                assert ( \dut.addend == ((tally <<< place) ^ {64{weight[32]}}));
            end
        end
    end
endmodule
